"""Closed-loop episodes of a learner in places that no demonstration has."""

from __future__ import annotations

import time
from typing import NamedTuple, Protocol

import numpy as np

from benchmarks.metaworld.features import Array, View, landmarks_of, percept_of
from benchmarks.metaworld.learners import LEARNERS, Learner
from benchmarks.metaworld.results import Cell, Result
from benchmarks.metaworld.simulation import HORIZON
from pacnet.datasets.demonstrations import Demonstrations

SEEDS = 1_000_000  # of episode e of draw d: SEEDS + 1000 d + e, which no demonstration has
EPISODES = 1_000  # most of a draw


class Simulated(Protocol):
    """What an episode needs of a `World`."""

    def reset(self, seed: int) -> Array:
        """Start an episode; return its first observation `[39]`."""
        ...

    def step(self, action: Array) -> tuple[Array, bool]:
        """Take a step; return the observation `[39]` and success."""
        ...


class Outcome(NamedTuple):
    """One episode."""

    success: bool
    """Whether Metaworld said so at any step."""
    steps: int
    held: int
    """Steps without an action."""
    seconds: list[float]
    """What the learner took for each step [s]."""


def evaluate(cell: Cell, world: Simulated, demonstrations: Demonstrations, episodes: int) -> Result:
    """Let a learner learn and act.

    Args:
        cell: what is measured.
        world: of the task.
        demonstrations: as recorded.
        episodes: how many, of successive seeds; the same for every learner.
    """
    seen, learner = cell.view.seen(demonstrations), LEARNERS[cell.learner]()
    began = time.perf_counter()
    learner.learn(seen)
    learning = time.perf_counter() - began
    first = SEEDS + EPISODES * cell.draw
    outcomes = [run(world, learner, first + episode, cell.view) for episode in range(episodes)]
    seconds = np.concatenate([one.seconds for one in outcomes])
    return Result(
        successes=[one.success for one in outcomes],
        steps=[one.steps for one in outcomes],
        held=sum(one.held for one in outcomes) / len(seconds),
        learning_s=learning,
        step_us=float(np.median(seconds) * 1e6),
    )


def run(world: Simulated, learner: Learner, seed: int, view: View) -> Outcome:
    """Run one episode until success or `HORIZON` steps; where the learner holds, nothing moves.

    Holding is the action zero: the hand stays, and the gripper neither closes nor opens.
    """
    random, observation = np.random.default_rng(seed), world.reset(seed)
    landmarks = landmarks_of(observation)
    learner.reset()
    held, seconds = 0, []
    for step in range(1, HORIZON + 1):
        percept = view.see(percept_of(observation, landmarks), random)
        began = time.perf_counter()
        action = learner.act(percept)
        seconds.append(time.perf_counter() - began)
        held += action is None
        observation, success = world.step(np.zeros(4) if action is None else action)
        if success:
            return Outcome(True, step, held, seconds)
    return Outcome(False, HORIZON, held, seconds)
