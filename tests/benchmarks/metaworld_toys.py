"""A made-up task for the tests of the Metaworld benchmark, which need no Metaworld."""

import numpy as np
import torch

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
