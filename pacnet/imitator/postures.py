"""Cameras of a robot of which nothing is a point: what they tell is a posture of its joints."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.records import EpisodeReport
from pacnet.schemas.demonstration_memory import Shown
from pacnet.schemas.warping import warped
from pacnet.vision.cameras import Cameras, GoalsShown
from pacnet.vision.fitting import CameraReport, fit_cameras
from pacnet.vision.goals import SHARES, goals_of
from pacnet.vision.sight import steps_of

Parts = list[tuple[int, int]]
"""Number of an episode's first demonstration, and that after its last."""

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
    """Whether each demonstration is of the episode whose goals are nearest, or corrects, `[E]`."""

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
    reason = None
    if config.targets != "action":
        reason = "targets are states"
    elif max(config.follows) < 0:
        reason = (
            "actions are neither places of the robot's state nor is its hand known; name it, with "
            "--points hand=observation.state[0:3] (points= in Python)"
        )
    if reason is not None:
        warnings.warn(f"cameras are not used: {reason}", DatasetWarning, stacklevel=4)
        return None, ()
    hands = postures_of(demonstrations, config)
    return fit_cameras(demonstrations, hands, config.state_names, encoder)


def warp(
    shown: Shown,
    allowed: NDArray[np.bool_],
    told: GoalsShown,
    goals: NDArray[np.float32],
    reports: Sequence[EpisodeReport],
    config: ImitatorConfig,
) -> Warped:
    """Return demonstrations with the goals that the cameras tell now.

    The one whose goals are nearest is followed, beside corrections, which begin where it never was.

    Args:
        shown: the demonstrations, whole.
        allowed: which of them may be followed, `[E]`.
        told: the goals of those that begin with pictures. Of corrections that do not, the end is
            the last goal; others stay as they are, and are followed where none with goals may be.
            What is not among the demonstrations yet is passed over.
        goals: what the cameras tell, `[G · S]`.
        reports: of the demonstrations, `[≥ E]`.
        config: of the imitator.
    """
    known = told.end <= len(shown.frames)
    parts = [*zip(told.first[known].tolist(), told.end[known].tolist(), strict=True)]
    apart = steps_of(goals) - steps_of(told.goals[known])
    rest = _corrected(reports[: len(shown.frames)], parts)
    rows = [(shown.first[first].item(), shown.first[end].item()) for first, end in parts + rest]
    ends = [_from_end(shown, first, end, goals, config) for first, end in rows[len(parts) :]]
    unit, follows = 1 / np.array(config.scaling.scale), np.array(config.follows, np.int64)
    differ = np.concatenate([apart, *ends])
    moved = warped(shown, rows, differ, SHARES, unit, follows, config.follows_after)
    return Warped(goals, shown, allowed, told, moved, _nearest(shown, allowed, parts, apart))


def _nearest(
    shown: Shown, allowed: NDArray[np.bool_], parts: Parts, apart: NDArray[np.floating]
) -> NDArray[np.bool_]:
    """Return which demonstrations are followed, `[E]`.

    Args:
        shown: the demonstrations.
        allowed: which of them may be followed, `[E]`.
        parts: of the N episodes that goals are told of.
        apart: by how much these differ from the goals now, `[N, G, S]`.
    """
    first, end = np.array(parts, np.int64).reshape(-1, 2).T
    kept = shown.first[end] > shown.first[first]
    usable = np.flatnonzero(allowed[first] & ~shown.correction[first] & kept)
    if len(usable) == 0:
        return allowed
    best = usable[np.square(apart[usable]).sum(axis=(1, 2)).argmin()]
    nearest = allowed & shown.correction
    nearest[slice(*parts[best])] = True
    return nearest


def _corrected(reports: Sequence[EpisodeReport], told: Parts) -> Parts:
    """Return the corrections of each episode that no goals are told of.

    One episode may have several: the last of them ends where the task does.
    """
    known = {number for part in told for number in range(*part)}
    parts: Parts = []
    for number, report in enumerate(reports):
        if not report.correction or number in known:
            continue
        before = reports[number - 1]  # the first demonstration is no correction
        same = (report.dataset, report.episode) == (before.dataset, before.episode)
        if parts and parts[-1][1] == number and same and report.first_frame > before.first_frame:
            parts[-1] = parts[-1][0], number + 1
        else:
            parts.append((number, number + 1))
    return parts


def _from_end(
    shown: Shown, first: int, end: int, goals: NDArray[np.float32], config: ImitatorConfig
) -> NDArray[np.floating]:
    """Return by how much rows that end elsewhere than the goals are to differ, `[1, G, S]`.

    That grows with time: where a correction begins has other reasons than what a camera sees.
    """
    steps, own = steps_of(goals), shown.percepts[first:end, : config.state_dimensions]
    if len(own) == 0:
        return np.zeros((1, *steps.shape))
    missing = steps[-1] - steps_of(goals_of(own, config.fps))[-1]
    return np.array(SHARES)[None, :, None] * missing
