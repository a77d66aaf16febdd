"""What a percept implies beyond its own numbers: where the hand is, and where things stood.

Where the hand is follows from the angles of the body. Where an object stood is remembered: it is
the place at which the hand left it alone, so that it can be put back there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pacnet.forward_models.kinematic_arrays import KinematicArrays
from pacnet.schemas.frames import FramesConfig

Array = NDArray[np.float64]

_AWAY = 0.3  # share of the scene's size: nearer, the hand may be about to take an object
_MOVED = 0.05  # share of the scene's size by which what was left alone was put elsewhere


class PerceptExtension:
    """Appends to percepts `[D]` what they imply, in order of time.

    Args:
        config: of the frames; its points are dimensions of the extended percepts.
        kinematics: of the body; None without one.
    """

    def __init__(self, config: FramesConfig, kinematics: KinematicArrays | None) -> None:
        self._body, self._kinematics = config.body, kinematics
        landmarks = config.points.landmarks
        self._hand = list(config.points.moved.place)
        self._objects = [list(landmarks[number].place) for number in config.put_back]
        self._extent = config.size.extent
        self.reset()

    def reset(self) -> None:
        """Begin a new episode."""
        self._stood: list[list[float]] = [[] for _ in self._objects]
        self._frames = [0] * len(self._objects)

    def __call__(self, percept: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return one percept `[D]` with what it implies, continuing from the last call."""
        return self._with_places(self._with_hand(percept[None])[0])

    def episode(
        self, percepts: NDArray[np.floating], *, goes_on: bool = False
    ) -> NDArray[np.floating]:
        """Return all percepts of an episode `[T, D]` with what they imply.

        Args:
            percepts: of the episode.
            goes_on: whether they are those after a gap, in the episode of the last call.
        """
        if not goes_on:
            self.reset()
        percepts = self._with_hand(percepts)
        if not self._objects:
            return percepts
        return np.stack([self._with_places(percept) for percept in percepts])

    def _with_hand(self, percepts: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return percepts `[T, D]` with where the hand is, place and quaternion."""
        if self._body is None or self._kinematics is None:
            return percepts
        from pacnet.forward_models.kinematic_kernels import poses_at  # imports numba

        angles = percepts[:, self._body.angles].astype(np.float64)
        return np.concatenate([percepts, poses_at(self._kinematics, angles)], axis=1)

    def _with_places(self, percept: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return a percept with where each object that is put back stood."""
        if not self._objects:
            return percept
        hand = percept[self._hand].tolist()
        for number, dimensions in enumerate(self._objects):
            self._remember(number, hand, percept[dimensions].tolist())
        return np.concatenate([percept, *self._stood])

    def _remember(self, number: int, hand: Sequence[float], place: list[float]) -> None:
        """Take in where an object is, unless the hand is near it; the mean of what was seen."""
        frames, stood = self._frames[number], self._stood[number]
        if frames and math.dist(hand, place) <= _AWAY * self._extent:
            return
        if frames and math.dist(stood, place) > _MOVED * self._extent:
            frames = 0
        share = 1 / (frames + 1)
        old = stood if frames else place
        self._stood[number] = [a + share * (b - a) for a, b in zip(old, place, strict=True)]
        self._frames[number] = frames + 1
