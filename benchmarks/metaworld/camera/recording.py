"""Demonstrations by noisy experts, with a picture of each frame, recorded as LeRobot datasets.

They are those of the same draw without a camera: the same seeds decide the same places and noise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.metaworld.camera.world import SIDE, Picture, SeenWorld
from benchmarks.metaworld.features import ACTION, STATE, Array
from benchmarks.metaworld.recording import SEEDS, recorder_of, successes
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Picture as CameraFeature

CAMERA = "observation.image"  # as LeRobot's environment of Metaworld calls it


class Watched:
    """A world in which a picture is taken of each observation.

    Attributes:
        pictures: of the episode so far.
    """

    def __init__(self, world: SeenWorld) -> None:
        self.task, self._world = world.task, world
        self.pictures: list[Picture] = []

    def reset(self, seed: int) -> Array:
        """Start an episode."""
        observation = self._world.reset(seed)
        self.pictures = [self._world.picture()]
        return observation

    def step(self, action: Array) -> tuple[Array, bool]:
        """Take a step."""
        observation, success = self._world.step(action)
        self.pictures.append(self._world.picture())
        return observation, success

    def expert(self, observation: Array) -> Array:
        """Return the scripted expert's action `[4]`."""
        return self._world.expert(observation)


def demonstrations_of(world: SeenWorld, draw: int, folder: Path) -> Path:
    """Return the dataset of a draw of a task; it is recorded where it is missing.

    Args:
        world: of the task.
        draw: which choice of places, from 0.
        folder: of all datasets.

    Raises:
        ExpertFailsError: as of `benchmarks.metaworld.recording`.
    """
    root = folder / f"{world.task}-{draw}"
    if root.exists():
        return root
    watched = Watched(world)
    features = {"observation.state": STATE, CAMERA: CameraFeature(SIDE, SIDE), "action": ACTION}
    with recorder_of(root, features) as recorder:
        for shown in successes(watched, SEEDS * (draw + 1)):
            states = shown.observations[:, : len(STATE)].astype(np.float32)
            pictures = np.stack(watched.pictures[: len(states)])
            frames = dict(zip(features, (states, pictures, shown.actions), strict=True))
            recorder.save_episode(world.task, frames)
    return root


def load(root: Path, number: int) -> Demonstrations:
    """Return the first demonstrations of a dataset, with their pictures."""
    return load_demonstrations(root, episodes=range(number), cameras="all")
