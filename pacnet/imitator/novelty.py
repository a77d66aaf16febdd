"""Novelty of percepts: in which dimension one is unlike what was shown, and by how much.

A percept is compared with the nearest one that was shown. How far demonstrations of a task are from
one another is measured by leaving each out, so no threshold has to be set by hand. With a single
one, there is nothing to measure, and the threshold is a share of its own range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.growable_rows import check_storage, copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.core.validation import is_integer
from pacnet.schemas.demonstration_memory import Shown

NOVEL = 1.0  # novelty above which a percept is novel
SMOOTHING = 0.2  # [s] over which deviations are averaged, from zero on: an episode begins known
PRIOR = 1.2  # least threshold from N demonstrations, in shares of their range, times N + 1
NEIGHBOURS = 5  # rows that are found for each frame of a demonstration
_TYPICAL = 0.9  # quantile of the deviations
_FEW = 8  # demonstrations up to which the margin is full; of N, it is _FEW / N of that
_MARGIN = 0.9  # of the threshold beyond the largest deviation of a usual demonstration
_USUAL, _MANY_USUAL = 0.5, 0.3  # quantile of their largest deviations, of few and of many
_MIN_TYPICAL = 0.2  # of one dimension, in shares of the quadratic mean over all
_MIN_RANGE = 0.5  # of one dimension, in shares of the quadratic mean over all
_COMPARED = 40  # demonstrations that are left out in turn, at most
_LEFT_OUT_FRAMES = 8_000  # of all of them; of more, every second, third, ... counts
_MOST, _LEAST_CAP = 5.0, 1.5  # thresholds by which one frame deviates, for its part in the average
_SEARCHED = 100_000  # frames; of more, the deviation is measured at every second, third, ... frame
_COMPARED_WITH = 50_000  # frames; of more, every second, third, ... demonstration is compared with
_GROWTH = 1.1  # demonstrations are compared again when there are so many times as many


class NoveltyScore(NamedTuple):
    """How far a percept is from what was shown, in the dimension where it is farthest."""

    novelty: float
    """Smoothed deviation over the threshold, in the dimension where that is largest; > 1 is new. A
    fifth of the percept's own deviation, if that is more."""
    dimension: int
    """Index of that dimension."""
    deviation: float
    """Signed difference of this percept from the nearest one shown, in that dimension, scaled."""
    threshold: float
    """The deviation above which that dimension is novel, scaled."""


class NoveltyDetector(nn.Module):
    """Scores percepts, one after the other, by their distance from those that were shown.

    Args:
        dimensions: length D of a percept.
        fps: frames per second [1/s].

    Raises:
        ValueError: not an integer ≥ 1.
    """

    thresholds: Tensor  # [D], scaled; deviations above are novel
    compared: Tensor  # number of demonstrations that the thresholds are from

    def __init__(self, dimensions: int, fps: float) -> None:
        super().__init__()
        if not is_integer(dimensions, 1):
            raise ValueError(f"expected dimensions as an integer ≥ 1, got {dimensions!r}")
        self.dimensions, self.rate = dimensions, min(1.0, 1 / (SMOOTHING * fps))
        self.register_buffer("thresholds", torch.ones(dimensions))
        self.register_buffer("compared", torch.tensor(0))
        self._deviation = np.zeros(dimensions, np.float32)  # smoothed, of a recall episode
        copy_on_state_dict(self)
        check_on_load(self)

    def reset(self) -> None:
        """Start a new recall episode: the smoothed deviation is zero again."""
        self._deviation[:] = 0

    def score(
        self, percept: NDArray[np.float32], nearest: NDArray[np.float32] | None
    ) -> NoveltyScore:
        """Score one percept, continuing from the last call; nothing is learned.

        Args:
            percept: scaled, `[D]`.
            nearest: the nearest one that was shown, scaled; None if nothing was.
        """
        thresholds = self.thresholds.numpy()
        if nearest is None:
            return NoveltyScore(math.inf, 0, math.inf, float(thresholds[0]))
        residual = percept - nearest
        apart = np.minimum(np.abs(residual), self._cap * thresholds)
        self._deviation += self.rate * (apart - self._deviation)
        # A single frame that is very far off is novel, but only for itself.
        ratio = np.maximum(self._deviation, np.abs(residual) / np.float32(_MOST)) / thresholds
        most = int(ratio.argmax())
        return NoveltyScore(
            float(ratio[most]), most, float(residual[most]), float(thresholds[most])
        )

    def novelty(self, percepts: NDArray[np.float32], shown: Shown) -> NDArray[np.float32]:
        """Return the novelty of an episode's percepts `[T]`, as `score` gives it; see `largest`."""
        return self._novelty(percepts, shown, 1, 1, np.ones(len(shown.frames), bool))[0]

    def largest(self, percepts: NDArray[np.float32], shown: Shown) -> tuple[float, NDArray]:
        """Return the largest novelty of an episode, and the nearest rows shown.

        Args:
            percepts: scaled, `[T ≥ 1, D]`, in order of time.
            shown: what it is compared with, at least one demonstration.

        Returns:
            The novelty, as `score` gives it, and the rows `[N, NEIGHBOURS]` that are nearest to the
            frames `[::stride]`, −1 where there are fewer; `stride` is that of `strides`.
        """
        stride = strides(shown)
        novelty, rows = self._novelty(percepts[::stride], shown, stride, NEIGHBOURS, _some(shown))
        return float(novelty.max()), rows

    def _novelty(
        self,
        percepts: NDArray[np.float32],
        shown: Shown,
        stride: int,
        neighbours: int,
        allowed: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Return the novelty `[N]` of every `stride`-th percept, and nearest rows."""
        apart, rows = _apart(percepts, shown, allowed, neighbours)
        thresholds = self.thresholds.numpy()
        smooth = self._smooth(np.minimum(apart, self._cap * thresholds), stride)
        return (np.maximum(smooth, apart / np.float32(_MOST)) / thresholds).max(axis=1), rows

    @property
    def _cap(self) -> float:
        """The most thresholds of one frame's deviation: it alone makes no later frame novel."""
        return max(_LEAST_CAP, min(_MOST, 0.9 / self.rate))

    def _smooth(self, apart: NDArray[np.float32], stride: int) -> NDArray[np.float32]:
        """Return the averages of every `stride`-th deviation `[N, D]`, in place."""
        rate, smooth = min(1.0, stride * self.rate), np.zeros(self.dimensions, np.float32)
        for frame in apart:
            smooth += rate * (frame - smooth)
            frame[:] = smooth
        return apart

    def is_due(self, demonstrations: int) -> bool:
        """Return whether there are enough more demonstrations to compare all again."""
        return demonstrations >= _GROWTH * int(check_storage("compared", self.compared))

    @torch.no_grad()
    def calibrate(self, shown: Shown) -> None:
        """Take the thresholds from how far demonstrations are from the others of their task.

        Corrections are known to be unlike the others, and are not asked.
        """
        corrections = shown.correction
        usual = np.flatnonzero(~corrections & (np.diff(shown.first) > 0))
        alike = [number for number in usual if np.sum(shown.task[usual] == shown.task[number]) > 1]
        some = np.unique(np.linspace(0, len(alike) - 1, min(_COMPARED, len(alike))).round())
        left_out = [alike[int(index)] for index in some]
        own = np.repeat(~corrections, np.diff(shown.first))
        spread = _range(shown.percepts[own] if own.any() else shown.percepts)
        thresholds = PRIOR * spread / (max(1, len(left_out)) + 1)
        if left_out:
            thresholds = np.maximum(self._compare(shown, left_out), thresholds)
        self.thresholds.copy_(torch.from_numpy(thresholds.astype(np.float32)))
        self.compared.fill_(len(shown.frames))

    def _compare(self, shown: Shown, left_out: list[int]) -> NDArray[np.float64]:
        """Return thresholds `[D]` from the deviations of demonstrations that are left out."""
        frames, every = int(np.diff(shown.first)[left_out].sum()), []
        stride = 1 + max(frames // _LEFT_OUT_FRAMES, len(shown.percepts) // _SEARCHED)
        for number in left_out:
            others = shown.task == shown.task[number]
            others[number] = False
            some = others & _some(shown)
            allowed = some if some.any() else others
            part = shown.percepts[shown.first[number] : shown.first[number + 1]][::stride]
            every.append(self._smooth(_apart(part, shown, allowed, 1)[0], stride))
        typical = np.quantile(np.concatenate(every), _TYPICAL, axis=0)
        typical = np.maximum(typical, _MIN_TYPICAL * math.sqrt(np.square(typical).mean()))
        typical = np.maximum(typical, 1e-9)  # of demonstrations that are the same
        largest = [float((deviations.max(axis=0) / typical).max()) for deviations in every]
        few = min(1.0, _FEW / len(left_out))
        usual = float(np.quantile(largest, max(_MANY_USUAL, _USUAL * few)))
        return typical * usual * (1 + _MARGIN * few)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        thresholds = tensors["thresholds"]
        check_conditions(
            {
                "thresholds > 0": ((thresholds > 0) & thresholds.isfinite()).all(),
                "demonstrations compared ≥ 0": tensors["compared"] >= 0,
            }
        )


def _some(shown: Shown) -> NDArray[np.bool_]:
    """Return with which demonstrations a new one is compared, bool `[E]`: of many, every few."""
    every = 1 + len(shown.percepts) // _COMPARED_WITH
    return np.arange(len(shown.frames)) % every == 0


def _apart(
    percepts: NDArray[np.float32],
    shown: Shown,
    allowed: NDArray[np.bool_],
    neighbours: int,
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return how far percepts `[N, D]` are from the nearest rows, and these, `[N, neighbours]`."""
    from pacnet.competition.following_kernels import nearest_rows  # imports numba

    rows = np.empty((len(percepts), neighbours), np.int64)
    nearest_rows(np.ascontiguousarray(percepts), shown, allowed, rows)
    return np.abs(percepts - shown.percepts[rows[:, 0]]), rows


def strides(shown: Shown) -> int:
    """Return every how many frames the deviation from what was shown is measured."""
    return 1 + len(shown.percepts) // _SEARCHED


def _range(percepts: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the range of each dimension, scaled `[D]`, at least a share of the others'."""
    ranges = np.ptp(percepts, axis=0).astype(np.float64)
    if not ranges.any():  # a single frame: nothing is known but the scale, from other data
        return np.ones_like(ranges)
    return np.maximum(ranges, _MIN_RANGE * math.sqrt(np.square(ranges).mean()))
