"""The scale of percepts: each dimension is divided by its spread in what was shown.

Distances sum over the dimensions, so these must be comparable. A dimension that is constant, or
that only settles at the beginning, has a tiny spread of its own: it is no finer than a share of the
spread of the dimensions that are like it. What is mostly noise counts less, since it says nothing
about where the robot is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.validation import check_fields, is_number
from pacnet.schemas.changes import RecentPercepts

_SHARE = 0.1  # of the median spread of dimensions that are alike: the least of one of them
_NOISE = 4.0  # how much less a dimension counts for its noise: pure noise counts a fifth
_MOVES = 0.1  # distance that counts as movement, in shares of the mean from frame to frame
_SECOND_DIFFERENCE = 0.6745 * 6**0.5  # median size of x[t + 1] − 2 x[t] + x[t − 1] of white noise
_LARGEST = 1e30  # of a factor, far within float32
_BEYOND_NOISE = 2.5  # lengths of the noise that count as movement, at least
# What the last part of a dimension's name says about its unit.
_UNITS = {
    "place": ("x", "y", "z"),
    "turn": ("roll", "pitch", "yaw", "rx", "ry", "rz", "theta"),
    "quaternion": ("qx", "qy", "qz", "qw"),
    "position": ("pos", "position", "angle", "q"),
    "speed": ("vel", "velocity", "speed", "vx", "vy", "vz", "omega"),
    "force": ("effort", "torque", "force", "current", "fx", "fy", "fz"),
}


@dataclass(frozen=True)
class Scaling:
    """Factors that make the D dimensions of percepts comparable.

    Attributes:
        scale: factor on each dimension [1/unit of the dimension].
        change_scale: the same for how a percept has changed lately; see `pacnet.schemas.changes`.
        movement: distance of scaled percepts that counts as movement.
    """

    scale: tuple[float, ...]
    change_scale: tuple[float, ...]
    movement: float

    def __post_init__(self) -> None:
        """Turn the lists that JSON reads into tuples, and check the fields."""
        for name in ("scale", "change_scale"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        factors = all(map(is_number, (*self.scale, *self.change_scale)))
        single = factors and max(map(abs, (*self.scale, *self.change_scale)), default=0) < _LARGEST
        alike = len(self.scale) == len(self.change_scale) > 0
        checks = {
            "scale": (
                single and alike and min(self.scale) > 1 / _LARGEST,
                "as positive finite factors",
            ),
            "change_scale": (single and alike and min(self.change_scale) >= 0, "as factors ≥ 0"),
            "movement": (is_number(self.movement) and self.movement >= 0, "≥ 0"),
        }
        check_fields(self, checks)

    @property
    def array(self) -> NDArray[np.float32]:
        """The factor on each dimension, `[D]`."""
        return np.array(self.scale, np.float32)

    @property
    def change_ratio(self) -> NDArray[np.float64]:
        """The factor on each dimension of how a scaled percept has changed, `[D]`."""
        return np.array(self.change_scale) / np.array(self.scale)

    def recent(self, fps: float) -> RecentPercepts:
        """Return the percepts of an episode that has not begun."""
        return RecentPercepts(len(self.scale), fps, self.movement)


def choose_scaling(
    episodes: Sequence[Tensor], features: Mapping[str, tuple[str, ...]], fps: float
) -> Scaling:
    """Return a scale from the spread of each dimension over all frames.

    Args:
        episodes: percepts of each, `[T ≥ 1, D]`, in order of time.
        features: feature -> names of its dimensions, D in all; dimensions of a feature are alike if
            their names end in the same unit.
        fps: frames per second [1/s].

    Raises:
        ValueError: no episode, or no dimension that changes.
    """
    if not episodes:
        raise ValueError("expected at least one episode to choose the scale from, got none")
    percepts = [episode.numpy() for episode in episodes]
    spread = np.concatenate(percepts).std(axis=0, dtype=np.float64)
    if not spread.any():
        raise ValueError("expected percepts that change, got the same one in every frame")
    noise = _noise(percepts)
    noisy = spread * (1 + _NOISE * np.minimum(1, np.square(noise / np.maximum(spread, 1e-300))))
    scale = 1 / np.maximum(noisy, _least_spread(spread, kinds_of(features)))
    scaled = [(part * scale).astype(np.float32) for part in percepts]
    steps = [np.linalg.norm(np.diff(part, axis=0), axis=1) for part in scaled]
    moved = np.concatenate(steps)
    moves = _MOVES * moved.mean(dtype=np.float64) if len(moved) else 0.0
    movement = max(float(moves), _BEYOND_NOISE * float(np.linalg.norm(noise * scale)))
    recent = RecentPercepts(len(scale), fps, movement)
    changes = []
    for part in scaled:
        recent.reset()
        changes.append(recent.changes(part))
    # About zero, not about their mean: what moves at one speed changes by as much all the time.
    usual = np.sqrt(np.square(np.concatenate(changes, dtype=np.float64)).mean(axis=0))
    usual *= 1 + _NOISE * np.minimum(1, 2 * np.square(noise * scale / np.maximum(usual, 1e-300)))
    usual = np.maximum(usual, _SHARE * np.median(usual[usual > 0])) if usual.any() else usual + 1
    return Scaling(tuple(scale.tolist()), tuple((scale / usual).tolist()), movement)


def _noise(episodes: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
    """Return the standard deviation of each dimension's noise; 0 if episodes are too short.

    It is the median of second differences, which neither steady movement nor rare jumps affect.
    """
    differences = np.concatenate(
        [np.diff(part.astype(np.float64), n=2, axis=0) for part in episodes]
    )
    if len(differences) == 0:
        return np.zeros(episodes[0].shape[1])
    return np.median(np.abs(differences), axis=0) / _SECOND_DIFFERENCE


def kinds_of(features: Mapping[str, tuple[str, ...]]) -> list[tuple[str, str]]:
    """Return for each dimension what it is alike in: its feature, and its unit by name."""
    units = {ending: unit for unit, endings in _UNITS.items() for ending in endings}
    return [
        (feature, units.get(re.split(r"[._\s-]", name.lower())[-1], ""))
        for feature, names in features.items()
        for name in names
    ]


def _least_spread(
    spread: NDArray[np.float64], kinds: Sequence[tuple[str, str]]
) -> NDArray[np.float64]:
    """Return the least spread of each dimension, a share of that of those that are alike."""
    least = np.full(len(spread), _SHARE * float(spread[spread > 0].min()))
    for kind in set(kinds):
        alike = np.array([other == kind for other in kinds])
        if spread[alike].any():
            least[alike] = _SHARE * np.median(spread[alike][spread[alike] > 0])
    return least
