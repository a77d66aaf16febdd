"""Keyframes: the frames of a demonstration that the others do not foretell.

What lies on the line between two frames needs no memory of its own. The frame that is farthest from
the line is the most novel one; it is kept, and what is left is compared with the two lines that it
makes. This is the polygonal approximation of Ramer (1972) and Douglas & Peucker (1973), in time and
all dimensions of a percept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.smoothing import moving_average

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_SMOOTHED = 0.2  # [s] over which percepts are averaged before they are compared
_ABOVE_NOISE = 0.8  # of what counts as movement, from which an average is more than noise


def importance(percepts: NDArray[np.floating], frame: Numbers) -> Array:
    """Return how far each frame is from what those of more importance foretell, `[T]`.

    The first and the last one are infinitely important. The K most important frames are keyframes.

    Args:
        percepts: scaled, `[T, D]`.
        frame: number of each, ascending, `[T]`.
    """
    from pacnet.schemas.keyframe_kernels import measure_importance  # imports numba

    out = np.zeros(len(percepts))
    if len(out):
        rows = np.ascontiguousarray(percepts, np.float64)
        measure_importance(rows, frame.astype(np.float64), out)
    return out


def keyframes(
    percepts: NDArray[np.floating], most: int, fps: float, movement: float
) -> tuple[Numbers, Array]:
    """Return the frames of a demonstration that are worth keeping, and their importance.

    Args:
        percepts: scaled, `[T ≥ 1, D]`, each frame.
        most: number of keyframes, at most.
        fps: frames per second [1/s].
        movement: distance of two percepts that is more than noise.

    Returns:
        Numbers of the frames, ascending, and how important each is, `[K]` each.
    """
    window = 2 * (round(_SMOOTHED * fps) // 2) + 1
    important = importance(moving_average(percepts, window), np.arange(len(percepts)))
    noise = _ABOVE_NOISE * movement / np.sqrt(window)
    kept = most_important(np.where(important > noise, important, 0.0), most)
    kept = kept[important[kept] > noise]
    return kept, important[kept]


def most_important(important: Array, most: int) -> Numbers:
    """Return the most important rows, in order; of equal ones the first."""
    return np.sort(np.argsort(-important, kind="stable")[:most])


def fitted(values: NDArray[np.floating], kept: Numbers) -> NDArray[np.float32]:
    """Return the values at keyframes from which all others are interpolated best, `[K, A]`.

    In the sense of least squares, which averages noise out; none is beyond what was shown.

    Args:
        values: at each frame, `[T, A]`.
        kept: numbers of the keyframes, ascending, `[K]`.
    """
    from pacnet.schemas.keyframe_kernels import fit_lines  # imports numba

    if len(kept) < 2:
        return values[kept].astype(np.float32)
    out = np.zeros((len(kept), values.shape[1]))
    fit_lines(np.ascontiguousarray(values, np.float64), kept, out)
    return out.clip(values.min(axis=0), values.max(axis=0)).astype(np.float32)
