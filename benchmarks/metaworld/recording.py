"""Demonstrations by Metaworld's scripted experts, recorded as LeRobot datasets.

The experts act with noise, so that demonstrations differ and show how errors are corrected. The
noisy action is the one that is executed and recorded.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from benchmarks.metaworld.features import (
    ACTION,
    STATE,
    Array,
    environment_names,
    landmarks_of,
    percept_of,
)
from benchmarks.metaworld.simulation import FPS, HORIZON
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Feature, Picture, Recorder

NUMBER = 20  # demonstrations of a draw
SEEDS = 10_000  # draw d takes the seeds from SEEDS (d + 1)
NOISE = 0.1  # standard deviation of the noise on an action within ±1
AFTER = 10  # frames recorded after success
LEAST_SUCCESS = 0.8  # of an expert
_PARTIAL = ".partial"


class ExpertFailsError(Exception):
    """A scripted expert succeeds too rarely to demonstrate its task."""


class Demonstrated(Protocol):
    """What an expert needs of a `World`."""

    task: str

    def reset(self, seed: int) -> Array:
        """Start an episode; return its first observation `[39]`."""
        ...

    def step(self, action: Array) -> tuple[Array, bool]:
        """Take a step; return the observation `[39]` and success."""
        ...

    def expert(self, observation: Array) -> Array:
        """Return the scripted expert's action `[4]`."""
        ...


class Shown(NamedTuple):
    """One successful episode of an expert."""

    observations: Array
    """`[T, 39]`."""
    actions: Array
    """`[T, 4]`, as executed."""


def demonstrations_of(world: Demonstrated, draw: int, folder: Path) -> Path:
    """Return the dataset of a draw of a task; it is recorded where it is missing.

    Args:
        world: of the task.
        draw: which choice of places, from 0.
        folder: of all datasets.

    Raises:
        ExpertFailsError: the expert succeeds in fewer than `LEAST_SUCCESS` of its episodes.
    """
    root = folder / f"{world.task}-{draw}"
    if root.exists():
        return root
    shown = list(successes(world, SEEDS * (draw + 1)))
    landmarks = landmarks_of(shown[0].observations[0])
    features = {
        "observation.state": STATE,
        "observation.environment_state": environment_names(landmarks),
        "action": ACTION,
    }
    with recorder_of(root, features) as recorder:
        for one in shown:
            percepts = percept_of(one.observations, landmarks)
            state, surroundings = np.split(percepts, [len(STATE)], axis=1)
            frames = dict(zip(features, (state, surroundings, one.actions), strict=True))
            recorder.save_episode(world.task, frames)
    return root


@contextmanager
def recorder_of(
    root: Path, features: Mapping[str, Sequence[str] | Feature | Picture]
) -> Iterator[Recorder]:
    """Give a recorder of a dataset that is there once it is whole."""
    partial = root.with_name(root.name + _PARTIAL)
    shutil.rmtree(partial, ignore_errors=True)
    with Recorder(partial, FPS, features) as recorder:
        yield recorder
    partial.rename(root)


def load(root: Path, number: int) -> Demonstrations:
    """Return the first demonstrations of a dataset."""
    return load_demonstrations(root, episodes=range(number))


def successes(world: Demonstrated, first_seed: int, number: int = NUMBER) -> Iterator[Shown]:
    """Yield successful episodes of an expert, of successive seeds.

    Raises:
        ExpertFailsError: too few succeed; it is told as soon as that is certain.
    """
    most = int(number / LEAST_SUCCESS)
    found = 0
    for tried in range(1, most + 1):
        shown = demonstrate(world, first_seed + tried - 1)
        if shown is not None:
            yield shown
            found += 1
        if found == number:
            return
        if tried - found > most - number:
            raise ExpertFailsError(f"{world.task}: its expert succeeded in {found} of {tried}")


def demonstrate(world: Demonstrated, seed: int) -> Shown | None:
    """Return one episode of the expert, until `AFTER` frames after success; None if it fails."""
    random, observation = np.random.default_rng(seed), world.reset(seed)
    observations, actions, left = [], [], None
    for _ in range(HORIZON):
        noisy = world.expert(observation) + random.normal(0, NOISE, len(ACTION))
        action = np.clip(noisy, -1, 1).astype(np.float32)
        observations.append(observation)
        actions.append(action)
        observation, success = world.step(action)
        if left is not None:
            left -= 1
        elif success:
            left = AFTER
        if left == 0:
            return Shown(np.array(observations), np.array(actions))
    return None
