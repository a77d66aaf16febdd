"""Cameras of a robot of which nothing is a point: what they tell is a posture of its joints."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.imitator.config import ImitatorConfig
from pacnet.schemas.demonstration_memory import Shown
from pacnet.schemas.warping import warped
from pacnet.vision.cameras import Cameras, GoalsShown
from pacnet.vision.fitting import CameraReport, fit_cameras
from pacnet.vision.goals import SHARES
from pacnet.vision.sight import steps_of

_SAME = 0.01  # scaled, by which goals may differ


class Warped(NamedTuple):
    """Demonstrations with the goals that the cameras tell."""

    goals: NDArray[np.float32]
    """`[G · S]`, scaled."""
    before: Shown
    """What they were made of."""
    allowed: NDArray[np.bool_]
    """Which of them might be followed, `[E]`."""
    told: GoalsShown
    """What their own pictures tell."""
    shown: Shown
    nearest: NDArray[np.bool_]
    """Whether each demonstration is of the episode whose goals are nearest, `[E]`."""

    def is_of(
        self,
        shown: Shown,
        allowed: NDArray[np.bool_],
        told: GoalsShown,
        goals: NDArray[np.float32],
    ) -> bool:
        """Return whether it was made of the same, and for goals that are as good; see `warp`."""
        same = self.before is shown and self.allowed is allowed and self.told is told
        return same and bool(np.abs(self.goals - goals).max() <= _SAME)


def postures_of(
    demonstrations: Demonstrations, config: ImitatorConfig
) -> list[NDArray[np.floating]]:
    """Return the robot's states, scaled, `[T, S]` each."""
    scale = config.scaling.array[: config.state_dimensions]
    return [shown.state.numpy() * scale for shown in demonstrations]


def see_postures(
    demonstrations: Demonstrations, config: ImitatorConfig, encoder: str
) -> tuple[Cameras | None, tuple[CameraReport, ...]]:
    """Fit cameras that tell postures; none where actions are not places of the robot's state.

    Args:
        demonstrations: whole episodes, with pictures.
        config: of an imitator without frames of reference.
        encoder: see `fit_cameras`.
    """
    follows = [dimension for dimension in config.follows if dimension >= 0]
    if config.targets != "action" or not follows:
        warnings.warn(
            "cameras are not used: actions are neither places of the robot's state nor is its hand "
            "known; name it, with --points hand=observation.state[0:3] (points= in Python)",
            DatasetWarning,
            stacklevel=4,
        )
        return None, ()
    hands = postures_of(demonstrations, config)
    return fit_cameras(demonstrations, hands, config.state_names, encoder)


def warp(
    shown: Shown,
    allowed: NDArray[np.bool_],
    told: GoalsShown,
    goals: NDArray[np.float32],
    config: ImitatorConfig,
) -> Warped:
    """Return demonstrations with the goals that the cameras tell now.

    Args:
        shown: the demonstrations, whole.
        allowed: which of them may be followed, `[E]`.
        told: the goals of those with pictures; others stay as they are, and are followed where
            none of these may be. What is not among the demonstrations yet is passed over.
        goals: what the cameras tell, `[G · S]`.
        config: of the imitator.
    """
    known = told.end <= len(shown.frames)
    first, end = told.first[known], told.end[known]
    episodes = [*zip(shown.first[first].tolist(), shown.first[end].tolist(), strict=True)]
    apart = steps_of(goals) - steps_of(told.goals[known])
    unit, follows = 1 / np.array(config.scaling.scale), np.array(config.follows, np.int64)
    moved = warped(shown, episodes, apart, SHARES, unit, follows, config.follows_after)
    usable = np.flatnonzero(allowed[first])
    nearest = allowed.copy()
    if len(usable):
        best = usable[np.square(apart[usable]).sum(axis=(1, 2)).argmin()]
        nearest[:] = False
        nearest[first[best] : end[best]] = True
    return Warped(goals, shown, allowed, told, moved, nearest)
