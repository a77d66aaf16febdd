"""Closed-loop episodes of a learner that sees, in places that no demonstration has."""

from __future__ import annotations

import time
from contextlib import closing
from typing import NamedTuple, Protocol

import numpy as np

from benchmarks.metaworld.camera.disturbances import DISTURBANCES, Disturb
from benchmarks.metaworld.camera.learners import LEARNERS, Seeing
from benchmarks.metaworld.camera.projection import Pinhole
from benchmarks.metaworld.camera.world import Picture
from benchmarks.metaworld.evaluation import EPISODES, SEEDS
from benchmarks.metaworld.features import GRIPPER, LANDMARKS, STATE, Array
from benchmarks.metaworld.results import Cell, Result
from benchmarks.metaworld.simulation import HORIZON
from pacnet.datasets.demonstrations import Demonstrations

ABSENT = "absent"  # the sight without what the task brings
SIGHTS = ("", *DISTURBANCES, ABSENT)
NEAR = 0.06  # from the hand to the object's first place, where it is about to touch it [m]


class Simulated(Protocol):
    """What an episode needs of a `SeenWorld`."""

    @property
    def camera(self) -> Pinhole:
        """The camera as it stands."""
        ...

    def reset(self, seed: int) -> Array:
        """Start an episode; return its first observation `[39]`."""
        ...

    def step(self, action: Array) -> tuple[Array, bool]:
        """Take a step; return the observation `[39]` and success."""
        ...

    def picture(self) -> Picture:
        """Return what the camera sees now."""
        ...


class Outcome(NamedTuple):
    """One episode."""

    success: bool
    steps: int
    held: int
    """Steps without an action."""
    first_held: int
    """The first of them; 0 for none."""
    reached: int
    """The first step at which the hand is at the object's first place; 0 for none."""
    seconds: list[float]
    """What the learner took for each step [s]."""


def evaluate(cell: Cell, world: Simulated, demonstrations: Demonstrations, episodes: int) -> Result:
    """Let a learner learn and act.

    Args:
        cell: what is measured.
        world: of the task; where the cell's sight is `ABSENT`, one without its object.
        demonstrations: as recorded.
        episodes: how many, of successive seeds; the same for every learner.
    """
    with closing(LEARNERS[cell.learner]()) as learner:
        began = time.perf_counter()
        learner.learn(demonstrations)
        learning = time.perf_counter() - began
        first = SEEDS + EPISODES * cell.draw
        seeds = range(first, first + episodes)
        outcomes = [run(world, learner, seed, cell.sight) for seed in seeds]
        note = learner.note
    seconds = np.concatenate([one.seconds for one in outcomes])
    return Result(
        successes=[one.success for one in outcomes],
        steps=[one.steps for one in outcomes],
        held=sum(one.held for one in outcomes) / len(seconds),
        learning_s=learning,
        step_us=float(np.median(seconds) * 1e6),
        first_held=[one.first_held for one in outcomes],
        reached=[one.reached for one in outcomes],
        note=note,
    )


def run(world: Simulated, learner: Seeing, seed: int, sight: str = "") -> Outcome:
    """Run one episode until success or `HORIZON` steps; where the learner holds, nothing moves.

    Without its object, it ends where the learner holds or the hand arrives.
    """
    observation = world.reset(seed)
    disturb = _disturbance(world, observation, seed, sight)
    learner.reset()
    place, held, first_held, reached, seconds = _object_of(observation), 0, 0, 0, []
    for step in range(1, HORIZON + 1):
        picture = disturb(world.picture()) if learner.sees else None
        state = observation[: len(STATE)].astype(np.float32)
        began = time.perf_counter()
        action = learner.act(state, picture)
        seconds.append(time.perf_counter() - began)
        if action is None:
            held, first_held = held + 1, first_held or step
        observation, success = world.step(np.zeros(4) if action is None else action)
        if np.linalg.norm(observation[:GRIPPER] - place) < NEAR:
            reached = reached or step
        if success or (sight == ABSENT and (first_held or reached)):
            break
    return Outcome(success, step, held, first_held, reached, seconds)


def _disturbance(world: Simulated, observation: Array, seed: int, sight: str) -> Disturb:
    """Return what happens to the pictures of an episode."""
    if sight not in DISTURBANCES:
        return lambda picture: picture
    goal = observation[LANDMARKS["goal"] :][:3]
    places = np.stack([observation[:GRIPPER], _object_of(observation), goal])
    draw = DISTURBANCES[sight]
    return draw(np.random.default_rng(seed), world.camera.pixel_of(places))


def _object_of(observation: Array) -> Array:
    """Return where the object is, `[3]`."""
    return observation[LANDMARKS["object"] :][:3]
