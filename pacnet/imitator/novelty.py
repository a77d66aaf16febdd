"""Novelty of percepts: in which dimension one is unlike the training data, and by how much.

A percept is compared with the nearest percept that was learned. How much demonstrations of the same
task differ is learned too, so no threshold has to be set by hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.growable_rows import Column, GrowableRows, check_storage, copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.core.old_names import old_names, rename_on_load
from pacnet.core.validation import MAX_VALUE, is_integer

MARGIN = 4.0  # threshold of a dimension, in multiples of its typical deviation
RATE = 0.1  # smoothing of residuals per percept: noise averages out over about twenty
_MOVEMENT_QUANTILE = 0.99  # of the changes from frame to frame in the first episode
_MIN_MOVEMENT = 0.25  # lower bound of a typical deviation, in shares of that quantile
_MIN_SHARE = 0.1  # the same, in shares of the quadratic mean over all dimensions
_MIN_DEVIATION = 1e-6  # the same, scaled, where nothing ever changed
_BLOCK = 2**18  # distances computed at once, which fit into a cache


class NoveltyScore(NamedTuple):
    """How far a percept is from the training data, in the dimension where it is farthest."""

    novelty: float
    """Smoothed deviation over the threshold, in the dimension where that is largest; > 1 is new."""
    dimension: int
    """Index of that dimension."""
    deviation: float
    """Signed difference of this percept from the nearest one learned, in that dimension, scaled."""
    threshold: float
    """The deviation above which that dimension is novel, scaled."""


@old_names(usual="typical_deviation", tolerance="thresholds")
class NoveltyDetector(nn.Module):
    """Scores percepts, one after the other, by their distance from those that were learned.

    The residual of a percept is its difference from the nearest percept learned, per dimension.
    The deviation is the residuals' size, smoothed from zero on, so one bad frame is not novel.
    Before an episode is learned, its largest deviation per dimension is recorded. The typical
    deviation is the lower median of these and of the changes from frame to frame in the first
    episode; the threshold is a multiple of it. So an episode of something new raises no threshold
    as long as at most half of all are like it. An episode marked as a correction never raises one.

    Args:
        dimensions: length D of a percept.

    Raises:
        ValueError: not an integer ≥ 1.

    Example:
        >>> detector = NoveltyDetector(2)
        >>> learned = np.float32([[0.0, 5.0], [0.1, 5.0], [0.2, 5.0]])
        >>> detector.learn(learned, None)
        >>> [detector.score(np.float32([0.1, 6.0]), learned).novelty > 1 for _ in range(3)]
        [True, True, True]
        >>> detector.score(np.float32([0.1, 6.0]), learned).dimension
        1
    """

    typical_deviation: Tensor

    def __init__(self, dimensions: int) -> None:
        super().__init__()
        if not is_integer(dimensions, 1):
            raise ValueError(f"expected dimensions as an integer ≥ 1, got {dimensions!r}")
        self.dimensions = dimensions
        self.episodes = GrowableRows({"deviation": Column((dimensions,), torch.float32)})
        self.register_buffer("typical_deviation", torch.full((dimensions,), _MIN_DEVIATION))
        self._deviation = np.zeros(dimensions, np.float32)  # smoothed, of a recall episode
        copy_on_state_dict(self)
        rename_on_load(self, {"usual": "typical_deviation"})
        check_on_load(self)

    @property
    def thresholds(self) -> NDArray[np.float32]:
        """The deviation above which each dimension is novel, scaled `[D]`.

        Raises:
            ValueError: the buffer `typical_deviation` was damaged from outside.
        """
        typical = check_storage("typical_deviation", self.typical_deviation)
        if typical.shape != (self.dimensions,):
            raise ValueError(
                f"expected typical_deviation as [{self.dimensions}], got {list(typical.shape)}"
            )
        deviations = typical.numpy(force=True)
        if not deviations.min() > 0:
            raise ValueError(f"expected typical_deviation > 0, got {deviations.tolist()}")
        return np.float32(MARGIN) * deviations

    def reset(self) -> None:
        """Start a new recall episode: the smoothed deviation is zero again."""
        self._deviation[:] = 0

    @torch.no_grad()
    def learn(
        self,
        percepts: NDArray[np.float32],
        cues: NDArray[np.float32] | None,
        *,
        correction: bool = False,
    ) -> float | None:
        """Learn typical deviations from an episode, before the episode itself is learned.

        In eval mode nothing is learned.

        Args:
            percepts: of the episode, scaled, `[T ≥ 1, D]`, in order of time.
            cues: all percepts learned before, scaled, `[R, D]`; None if there are none.
            correction: whether the episode is known to be novel, so its deviations are not typical;
                ignored for the first episode.

        Returns:
            The largest novelty in the episode, by the thresholds before it; None without cues.

        Raises:
            ValueError: wrong shape or dtype, no percepts, not finite or too large; nothing was
                learned then.
        """
        self.episodes.check()
        thresholds = self.thresholds
        known = np.zeros((0, self.dimensions), np.float32) if cues is None else cues
        for name, rows in (("percepts", percepts), ("cues", known)):
            _check_array(name, rows, 2, self.dimensions)
            if len(rows) and not np.abs(rows).max() <= MAX_VALUE:  # NaN is not
                raise ValueError(f"expected finite {name} within ±{MAX_VALUE:g}, got others")
        if len(percepts) == 0:
            raise ValueError("expected at least one percept, got none")
        if len(known) == 0:
            largest, novelty = _movement(percepts), None
        else:
            largest = _largest_deviation(percepts, known)
            novelty = float((largest / thresholds).max())
        is_typical = len(self.episodes) == 0 or not correction
        if self.training and is_typical and len(percepts) > 1:  # one has no movement and no noise
            self._add_episode(largest)
        return novelty

    def score(self, percept: NDArray[np.float32], cues: NDArray[np.float32]) -> NoveltyScore:
        """Score one percept, continuing from the last call; nothing is learned.

        Args:
            percept: scaled, `[D]`.
            cues: all percepts learned, scaled, `[R, D]`; without any, everything is novel.

        Raises:
            ValueError: wrong shape or dtype, not finite or too large; nothing has changed.
        """
        _check_array("a percept", percept, 1, self.dimensions)
        _check_array("cues", cues, 2, self.dimensions)
        if not np.abs(percept).max() <= MAX_VALUE:  # NaN is not
            raise ValueError(
                f"expected a finite percept within ±{MAX_VALUE:g}, got {percept.tolist()}"
            )
        if len(cues) == 0:
            return NoveltyScore(math.inf, 0, math.inf, float(self.thresholds[0]))
        residual = residual_of(percept, cues)
        if not np.abs(residual).max() <= 2 * MAX_VALUE:  # NaN is not
            raise ValueError(f"expected finite cues within ±{MAX_VALUE:g}, got others")
        self._deviation += RATE * (np.abs(residual) - self._deviation)
        thresholds = self.thresholds
        ratio = self._deviation / thresholds
        most = int(ratio.argmax())
        return NoveltyScore(
            float(ratio[most]), most, float(residual[most]), float(thresholds[most])
        )

    def _add_episode(self, largest: NDArray[np.float32]) -> None:
        """Record the largest deviations of an episode `[D]` and update the typical ones."""
        with torch.inference_mode(False):
            self.episodes.append({"deviation": torch.from_numpy(largest)})
            # `median` of torch is the lower one: of two episodes the calmer one counts.
            deviation = self.episodes.live("deviation")
            typical = deviation.median(dim=0).values.maximum(_MIN_MOVEMENT * deviation[0])
            overall = float(typical.square().mean().sqrt())
            lowest = max(_MIN_DEVIATION, _MIN_SHARE * overall)
            self.typical_deviation.copy_(typical.clamp(min=lowest))

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        typical, deviations = tensors["typical_deviation"], tensors["episodes.deviation"]
        check_conditions(
            {
                "typical_deviation > 0": ((typical > 0) & typical.isfinite()).all(),
                "finite deviations ≥ 0": ((deviations >= 0) & deviations.isfinite()).all(),
            }
        )


def _check_array(name: str, rows: Any, ndim: int, width: int) -> None:
    """Raise a ValueError unless this is a float32 array `[width]` or `[rows, width]`."""
    is_array = isinstance(rows, np.ndarray) and not isinstance(rows, np.ma.MaskedArray)
    if is_array and rows.dtype == np.float32 and rows.ndim == ndim and rows.shape[-1] == width:
        return
    got = f"{rows.dtype} {list(rows.shape)}" if is_array else type(rows).__name__
    shape = [width] if ndim == 1 else f"[rows, {width}]"
    raise ValueError(f"expected {name} as a float32 array {shape}, got {got}")


def residual_of(percept: NDArray[np.float32], cues: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the difference `[D]` of a percept `[D]` from the nearest of the cues `[R ≥ 1, D]`."""
    from pacnet.kernels.distances import distances_of  # which imports numba

    return percept - cues[distances_of(percept, cues).argmin()]


def _movement(percepts: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return how much an episode `[T, D]` changes from frame to frame `[D]`, noise included."""
    if len(percepts) < 2:
        return np.zeros(percepts.shape[1], np.float32)
    steps = np.abs(np.diff(percepts, axis=0))
    return np.quantile(steps, _MOVEMENT_QUANTILE, axis=0).astype(np.float32)


def _largest_deviation(
    percepts: NDArray[np.float32], cues: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the largest smoothed deviation of an episode `[T, D]` in each dimension `[D]`."""
    deviation, largest = np.zeros((2, percepts.shape[1]), np.float32)
    for size in np.abs(percepts - cues[_nearest(percepts, cues)]):
        deviation += RATE * (size - deviation)
        np.maximum(largest, deviation, out=largest)
    return largest


def _nearest(percepts: NDArray[np.float32], cues: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the index of the cue `[R, D]` that is nearest to each percept `[T, D]`."""
    # |x − c|² without |x|², which is the same for all cues; both are centred against rounding.
    center = cues.mean(axis=0, dtype=np.float64).astype(np.float32)
    known = torch.from_numpy(cues - center)
    squares = known.square().sum(dim=1)
    parts = torch.from_numpy(percepts - center).split(max(1, _BLOCK // len(cues)))
    distances = (torch.addmm(squares, part, known.T, alpha=-2).numpy() for part in parts)
    return np.concatenate([rows.argmin(axis=1) for rows in distances])  # faster than torch's
