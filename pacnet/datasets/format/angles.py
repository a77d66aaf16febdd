"""Angles that wrap: a joint that turns past ±180° jumps by a full turn in its numbers."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class _Turn(NamedTuple):
    period: float
    name: str
    unwrap: str  # the call of numpy that undoes the jumps


_TURNS = (
    _Turn(360.0, "360 degrees", "numpy.unwrap(angle, period=360)"),
    _Turn(2 * np.pi, "2 pi", "numpy.unwrap(angle)"),
)
_BLOCK = 64  # rows
# Shares of a period. A joint that turns by 60 degrees a frame covers 300 of 360.
_LEAST_RANGE = 0.8
_OUTSIDE = 0.003  # by which a value may lie outside of [-1/2, 1/2] or [0, 1]
_LARGE_STEP = 0.5
_USUAL_STEP = 0.2  # most other steps are shorter; those of random numbers are not
_RESOLUTION = 1 / 360
# Chosen on made-up signals: more finds sawtooths and grippers, less misses joints at rest.
_TOLERANCE = 0.25  # of the longest step beside a wrap
_NOISE = 3.0


def find_wraps(
    values: Sequence[NDArray[Any]],
    episodes: Sequence[int],
    names: Sequence[str],
    fps: float,
    feature: str,
) -> list[str]:
    """Describe the dimensions of a feature that are angles and wrap by a full turn.

    Args:
        values: the feature in each episode, finite, `[T, D]`.
        episodes: index of each episode.
        names: names of the dimensions, D.
        fps: frames per second [1/s].
        feature: name of the feature.

    Returns:
        A sentence for each such dimension.
    """
    parts = [part for part in values if len(part)]
    if not parts:
        return []
    rows = np.concatenate(parts)
    owner = np.repeat(np.arange(len(values)), [len(part) for part in values])
    lowest, highest = _extremes(rows)
    notes = []
    for turn in _TURNS:
        for dimension in np.flatnonzero(_may_be_angle(lowest, highest, turn.period)):
            wraps = _wraps(rows[:, dimension].astype(np.float64), owner, turn.period)
            if wraps.size:
                first = owner[wraps[0]]
                time = (wraps[0] - np.searchsorted(owner, first)) / fps
                place = f"first in episode {episodes[int(first)]} at {time:.2f} s"
                often = "once" if wraps.size == 1 else f"{wraps.size} times"
                name = f"{feature!r}, {names[int(dimension)]!r}"
                notes.append(_describe(name, turn, f"{often}, {place}"))
    return notes


def _extremes(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the lowest and the highest number of each dimension; numpy is slow on short rows."""
    dimensions, whole = rows.shape[1], len(rows) // _BLOCK * _BLOCK
    blocks = rows[:whole].reshape(-1, _BLOCK * dimensions)
    found = []
    for extreme in (np.minimum, np.maximum):
        parts = [rows[whole:]]
        if len(blocks):
            parts.append(extreme.reduce(blocks).reshape(_BLOCK, dimensions))
        found.append(extreme.reduce(np.concatenate(parts)))
    return found[0], found[1]


def _describe(name: str, turn: _Turn, events: str) -> str:
    return (
        f"{name}: an angle that jumps by a full turn, {turn.name} ({events}). The imitator takes "
        f"its two ends for far apart: store it unwrapped ({turn.unwrap}) or as its sine and cosine."
    )


def _may_be_angle(lowest: NDArray[Any], highest: NDArray[Any], period: float) -> NDArray[np.bool_]:
    """Return which dimensions cover most of [-P/2, P/2] or [0, P] and leave neither, `[D]`."""
    slack = _OUTSIDE * period
    centred = (lowest >= -period / 2 - slack) & (highest <= period / 2 + slack)
    positive = (lowest >= -slack) & (highest <= period + slack)
    return (centred | positive) & (highest - lowest >= _LEAST_RANGE * period)


def _wraps(angle: NDArray[np.float64], owner: NDArray[np.intp], period: float) -> NDArray[np.intp]:
    """Return the rows of an angle `[N]` that follow on a wrap; none if it is no angle."""
    steps = np.diff(angle)
    within = owner[1:] == owner[:-1]
    large = within & (np.abs(steps) > _LARGE_STEP * period)
    at, others = np.flatnonzero(large), np.abs(steps[within & ~large])
    none = np.empty(0, dtype=np.intp)
    if not at.size or not others.size or np.quantile(others, 0.9) > _USUAL_STEP * period:
        return none
    small = np.where(within & ~large, steps, np.nan)
    around = np.pad(small, 2, constant_values=np.nan)[at[:, None] + [0, 1, 3, 4]]
    across = steps[at] - np.sign(steps[at]) * period  # what is left of the jumps
    unmoved = np.maximum(_RESOLUTION * period, _NOISE * _noise(small))
    alike = _continues(across, around, _USUAL_STEP * period)
    genuine = alike | (np.abs(across) <= unmoved)
    return at[genuine] + 1 if 2 * genuine.sum() >= at.size else none


def _noise(steps: NDArray[np.float64]) -> float:
    """Return how far most steps `[N - 1]` go back and forth; NaN steps are unknown."""
    before, after = steps[:-1], steps[1:]
    known = np.isfinite(before) & np.isfinite(after)
    before, after = before[known], after[known]
    back = np.where(before * after < 0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    return float(np.quantile(back, 0.9)) if back.size else 0.0


def _continues(
    across: NDArray[np.float64], around: NDArray[np.float64], longest: float
) -> NDArray[np.bool_]:
    """Return which steps `[K]` are like the two before and the two after each, `[K, 4]`."""
    least, most = np.fmin.reduce(around, axis=1), np.fmax.reduce(around, axis=1)
    size = np.maximum(np.abs(least), np.abs(most))
    margin = _TOLERANCE * size
    return (across >= least - margin) & (across <= most + margin) & (size <= longest)
