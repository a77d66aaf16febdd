"""Whether a percept is like what was learned, in each dimension: what is new, and by how much.

A percept is compared with the nearest of all percepts that were learned. By how much demonstrations
of the same thing differ is learned too, so that nobody has to set a threshold for every dimension.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.growable_rows import Column, GrowableRows, check_storage, copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.core.validation import MAX_VALUE, is_integer

MARGIN = 4.0  # times what is usual is tolerated
RATE = 0.1  # per percept, at which residuals are followed: noise averages out over some twenty
_MOVEMENT = 0.99  # quantile of the changes from frame to frame, which one demonstration shows
_LEAST_MOVEMENT = 0.25  # of that movement is usual at least, where all repeat one another exactly
_LEAST_SHARE = 0.1  # of all dimensions' usual deviation that is usual in a dimension at least
_LEAST = 1e-6  # usual in a dimension at least, scaled, where nothing ever changed
_AT_ONCE = 2**18  # distances computed at once, which a cache holds


class Judgement(NamedTuple):
    """How far a percept is from what was learned, where it is farthest for what is usual there."""

    novelty: float
    """The deviation over what is tolerated, in the dimension where that is most; > 1 is new."""
    dimension: int
    """That dimension."""
    deviation: float
    """By how much this percept is more than what is known, there, scaled; less if negative."""
    tolerated: float
    """The deviation at which that dimension is new, scaled."""


class Familiarity(nn.Module):
    """Judges percepts, one after the other, by the percepts that were learned.

    A percept's residual is its difference from the nearest percept known, dimension by dimension.
    The deviation follows the residuals' size, from zero, so that one bad frame does not make a
    situation new. Before a further episode is learned, its largest deviation in each dimension is
    noted. Of these, with what the first episode changed by from frame to frame, the lower median is
    what is usual; a few times that is tolerated. So an episode of something new widens nothing as
    long as no more than half of all are like that; one that is said to be a correction never does.

    Args:
        dimensions: length D of a percept.

    Raises:
        ValueError: not an integer ≥ 1.

    Example:
        >>> familiarity = Familiarity(2)
        >>> known = np.float32([[0.0, 5.0], [0.1, 5.0], [0.2, 5.0]])
        >>> familiarity.learn(known, None)
        nan
        >>> [familiarity.judge(np.float32([0.1, 6.0]), known).novelty > 1 for _ in range(3)]
        [True, True, True]
        >>> familiarity.judge(np.float32([0.1, 6.0]), known).dimension
        1
    """

    usual: Tensor

    def __init__(self, dimensions: int) -> None:
        super().__init__()
        if not is_integer(dimensions, 1):
            raise ValueError(f"expected dimensions as an integer ≥ 1, got {dimensions!r}")
        self.dimensions = dimensions
        self.episodes = GrowableRows({"deviation": Column((dimensions,), torch.float32)})
        self.register_buffer("usual", torch.full((dimensions,), _LEAST))  # scaled
        self._deviation = np.zeros(dimensions, np.float32)  # of a recall episode
        copy_on_state_dict(self)
        check_on_load(self)

    @property
    def tolerance(self) -> NDArray[np.float32]:
        """The deviation at which a dimension is new, scaled `[D]`.

        Raises:
            ValueError: what is usual is no longer that, by somebody's change.
        """
        usual = check_storage("usual", self.usual)
        if usual.shape != (self.dimensions,):
            raise ValueError(f"expected usual as [{self.dimensions}], got {list(usual.shape)}")
        deviations = usual.numpy(force=True)
        if not deviations.min() > 0:
            raise ValueError(f"expected usual deviations > 0, got {deviations.tolist()}")
        return np.float32(MARGIN) * deviations

    def reset(self) -> None:
        """Starts a new recall episode: percepts judged before are forgotten."""
        self._deviation[:] = 0

    @torch.no_grad()
    def learn(
        self,
        percepts: NDArray[np.float32],
        cues: NDArray[np.float32] | None,
        *,
        correction: bool = False,
    ) -> float:
        """Learns what is usual from an episode, before the episode itself is learned.

        In eval mode nothing is learned.

        Args:
            percepts: of the episode, scaled, `[T, D]`, in order of time.
            cues: all percepts that were learned before, scaled, `[R, D]`; None if there are none.
            correction: whether it is of something that is known to be new, and tells nothing about
                what is usual; the first episode always does.

        Returns:
            The largest novelty in the episode, by what was usual before it; NaN without cues.

        Raises:
            ValueError: of the wrong shape or dtype, no percepts, not finite or too large; nothing
                was learned then.
        """
        self.episodes.check()
        tolerance = self.tolerance
        self._check("percepts", percepts)
        known = np.zeros((0, self.dimensions), np.float32) if cues is None else cues
        _check_arrays("expected cues", known)
        if cues is None or len(known) == 0:
            largest, novelty = _movement(percepts), math.nan
        else:
            self._check("cues", cues)
            largest = _largest_deviation(percepts, cues)
            novelty = float((largest / tolerance).max())
        tells = len(self.episodes) == 0 or not correction
        if self.training and tells and len(percepts) > 1:  # one shows neither movement nor noise
            self._note(largest)
        return novelty

    def judge(self, percept: NDArray[np.float32], cues: NDArray[np.float32]) -> Judgement:
        """Judges one percept; goes on from the last call, and learns nothing.

        Args:
            percept: scaled, `[D]`.
            cues: all percepts that were learned, scaled, `[R, D]`; without any, all is new.

        Raises:
            ValueError: of the wrong shape or dtype, not finite or too large; nothing has changed.
        """
        wanted = f"expected a percept [{self.dimensions}] and cues [rows, {self.dimensions}]"
        _check_arrays(wanted, percept, cues)
        if percept.shape != (self.dimensions,) or cues.shape[1:] != percept.shape:
            raise ValueError(f"{wanted}, got {list(percept.shape)} and {list(cues.shape)}")
        if not np.abs(percept).max() <= MAX_VALUE:  # NaN is not
            raise ValueError(
                f"expected a finite percept within ±{MAX_VALUE:g}, got {percept.tolist()}"
            )
        _check_single(percept, cues)
        if len(cues) == 0:
            return Judgement(math.inf, 0, math.inf, float(self.tolerance[0]))
        residual = residual_of(percept, cues)
        if not np.abs(residual).max() <= 2 * MAX_VALUE:  # NaN is not
            raise ValueError(f"expected finite cues within ±{MAX_VALUE:g}, got others among them")
        self._deviation += RATE * (np.abs(residual) - self._deviation)
        tolerance = self.tolerance
        ratio = self._deviation / tolerance
        most = int(ratio.argmax())
        return Judgement(float(ratio[most]), most, float(residual[most]), float(tolerance[most]))

    def _note(self, largest: NDArray[np.float32]) -> None:
        """Takes in the largest deviations of one more episode `[D]`."""
        with torch.inference_mode(False):
            self.episodes.append({"deviation": torch.from_numpy(largest)})
            # The lower median, which torch takes: between two episodes, the calmer one.
            deviation = self.episodes.live("deviation")
            usual = deviation.median(dim=0).values.maximum(_LEAST_MOVEMENT * deviation[0])
            overall = float(usual.square().mean().sqrt())
            self.usual.copy_(usual.clamp(min=max(_LEAST, _LEAST_SHARE * overall)))

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        usual, deviations = tensors["usual"], tensors["episodes.deviation"]
        check_conditions(
            {
                "usual deviations > 0": ((usual > 0) & usual.isfinite()).all(),
                "finite deviations ≥ 0": ((deviations >= 0) & deviations.isfinite()).all(),
            }
        )

    def _check(self, name: str, rows: NDArray[np.float32]) -> None:
        wanted = f"expected {name} of shape [rows ≥ 1, {self.dimensions}]"
        _check_arrays(wanted, rows)
        if rows.ndim != 2 or rows.shape[1] != self.dimensions or len(rows) == 0:
            raise ValueError(f"{wanted}, got {list(rows.shape)}")
        if not np.abs(rows).max() <= MAX_VALUE:  # NaN is not
            raise ValueError(f"expected finite {name} within ±{MAX_VALUE:g}, got others among them")
        _check_single(rows)


def _check_arrays(wanted: str, *values: object) -> None:
    """Raises a ValueError unless these are arrays of floats, none of them masked."""
    for value in values:
        if not isinstance(value, np.ndarray) or isinstance(value, np.ma.MaskedArray):
            raise ValueError(f"{wanted}, as an array, got {type(value).__name__}")
        if value.dtype.kind != "f" or value.ndim == 0:
            raise ValueError(f"{wanted}, of floats, got {value.dtype} {list(value.shape)}")


def _check_single(*values: NDArray[np.floating]) -> None:
    """Raises a ValueError unless these are of float32."""
    for value in values:
        if value.dtype != np.float32:
            raise ValueError(f"expected percepts and cues as float32, got {value.dtype}")


def residual_of(percept: NDArray[np.float32], cues: NDArray[np.float32]) -> NDArray[np.float32]:
    """The difference `[D]` of a percept `[D]` from the nearest of the cues `[R ≥ 1, D]`."""
    from pacnet.kernels.distances import distances_of  # which brings numba

    return percept - cues[distances_of(percept, cues).argmin()]


def _movement(percepts: NDArray[np.float32]) -> NDArray[np.float32]:
    """How much an episode `[T, D]` changes from frame to frame `[D]`, noise included."""
    if len(percepts) < 2:
        return np.zeros(percepts.shape[1], np.float32)
    steps = np.abs(np.diff(percepts, axis=0))
    return np.quantile(steps, _MOVEMENT, axis=0).astype(np.float32)


def _largest_deviation(
    percepts: NDArray[np.float32], cues: NDArray[np.float32]
) -> NDArray[np.float32]:
    """The largest size that the deviation comes to in each dimension `[D]`."""
    deviation, largest = np.zeros((2, percepts.shape[1]), np.float32)
    for size in np.abs(percepts - cues[_nearest(percepts, cues)]):
        deviation += RATE * (size - deviation)
        np.maximum(largest, deviation, out=largest)
    return largest


def _nearest(percepts: NDArray[np.float32], cues: NDArray[np.float32]) -> NDArray[np.int64]:
    """The number of the cue `[R, D]` that is nearest to each percept `[T, D]`."""
    # |x − c|² without |x|², which is the same for all; around their middle, where little is lost.
    middle = cues.mean(axis=0, dtype=np.float64).astype(np.float32)
    known = torch.from_numpy(cues - middle)
    squares = known.square().sum(dim=1)
    parts = torch.from_numpy(percepts - middle).split(max(1, _AT_ONCE // len(cues)))
    distances = (torch.addmm(squares, part, known.T, alpha=-2).numpy() for part in parts)
    return np.concatenate([rows.argmin(axis=1) for rows in distances])  # faster than torch's
