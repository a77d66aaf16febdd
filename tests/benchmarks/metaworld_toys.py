"""A made-up task for the tests of the Metaworld benchmark, which need no Metaworld."""

import numpy as np
import torch

from benchmarks.metaworld.camera.projection import Pinhole
from benchmarks.metaworld.camera.world import SIDE, Picture
from benchmarks.metaworld.features import ACTION, STATE, Array, environment_names
from pacnet.datasets.demonstrations import Demonstration, Demonstrations

GAIN = 10.0  # action per metre from the hand to the object


def observation(hand: Array, thing: Array, goal: Array, second: Array | None = None) -> Array:
    """Return 39 numbers in Metaworld's order; the gripper is open."""
    numbers = np.full(39, 7.0)  # what nobody should look at
    numbers[:3], numbers[3], numbers[4:7], numbers[36:] = hand, 1.0, thing, goal
    numbers[11:14] = 0 if second is None else second
    return numbers


def reaching(seed: int, frames: int = 40) -> tuple[Array, Array]:
    """Return percepts `[T, 10]` and actions `[T, 4]` of an unsteady hand at an object."""
    random = np.random.default_rng(seed)
    hand, thing, goal = random.uniform(-0.2, 0.2, (3, 3))
    percepts, actions = [], []
    for _ in range(frames):
        action = np.append(GAIN * (thing - hand), 0.0)
        percepts.append(np.concatenate([hand, [1.0], thing, goal]))
        actions.append(action)
        hand = hand + 0.01 * action[:3] + random.normal(0, 0.03, 3)
    return np.array(percepts, np.float32), np.array(actions, np.float32)


def demonstrations(number: int, first_seed: int = 0) -> Demonstrations:
    """Return some demonstrations of reaching."""
    episodes = []
    for index in range(number):
        percepts, actions = map(torch.from_numpy, reaching(first_seed + index))
        parts = percepts[:, :4].clone(), percepts[:, 4:].clone(), actions
        episodes.append(Demonstration(index, "reach", *parts))
    names = {
        "observation.state": STATE,
        "observation.environment_state": environment_names(("object", "goal")),
        "action": ACTION,
    }
    return Demonstrations(80, names, tuple(episodes), "toy")


class ToyWorld:
    """A world in which a hand succeeds within 1 cm of an object; places are decided by a seed."""

    def reset(self, seed: int) -> Array:
        """Start an episode."""
        self.seeds = [*getattr(self, "seeds", []), seed]
        self.hand, self.thing, self.goal = np.random.default_rng(seed).uniform(-0.2, 0.2, (3, 3))
        self.commands: list[Array] = []
        return observation(self.hand, self.thing, self.goal)

    def step(self, action: Array) -> tuple[Array, bool]:
        """Move the hand."""
        self.commands.append(action)
        self.hand = self.hand + 0.01 * np.clip(action[:3], -1, 1)
        near = np.linalg.norm(self.hand - self.thing) < 0.01
        return observation(self.hand, self.thing, self.goal), bool(near)


class SeenToyWorld(ToyWorld):
    """The same seen from above, 40 × 40 cm of it: the nearer to the object, the brighter."""

    def __init__(self, task: str = "reach", *, absent: bool = False) -> None:
        self.task, self.absent, self.taken = task, absent, 0

    @property
    def camera(self) -> Pinhole:
        """A camera that looks down from 1 m above."""
        fovy = float(2 * np.degrees(np.arctan(0.2)))
        return Pinhole(np.array([0.0, 0.0, 1.0]), np.eye(3), fovy, SIDE)

    def picture(self) -> Picture:
        """Return what is seen."""
        self.taken += 1
        seen = np.zeros((SIDE, SIDE, 3), np.uint8)
        if not self.absent:
            row, column = np.round((0.5 + self.thing[:2] / 0.4) * (SIDE - 1))
            rows, columns = np.ogrid[:SIDE, :SIDE]
            apart = np.hypot(rows - row, columns - column)
            seen[:] = np.clip(200 - 2 * apart, 0, None)[..., None]
        return seen

    def expert(self, seen: Array) -> Array:
        """Return the way to the object."""
        return np.append(GAIN * (seen[4:7] - seen[:3]), -1.0)

    def close(self) -> None:
        """Do nothing."""
