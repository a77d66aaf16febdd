"""Measures of how well an imitation matches a demonstration, from plain arrays.

The paper compares two wrist paths by eye (Figure 7) and proposes the area between the curves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.arrays import finite_array


class PathDistances(NamedTuple):
    """Distances between the points of the same instant on two paths [m]."""

    mean: float
    maximum: float


def area_between_curves(path_a: ArrayLike, path_b: ArrayLike) -> float:
    """Return the area swept by the segment that joins the two points of the same instant.

    Between two instants that segment sweeps a strip of a ruled surface with the corners
    a_t, a_t+1, b_t+1, b_t. Either diagonal cuts the strip into two triangles; the mean of both
    cuts is taken, so that the measure is symmetric:

        area = sum_t (|a_t a_t+1 b_t| + |a_t+1 b_t+1 b_t| + |a_t a_t+1 b_t+1| + |a_t b_t+1 b_t|) / 2

    with |pqr| = |(q - p) x (r - p)| / 2. The area has no sign and counts as often as it is swept.
    It is exact for flat convex strips, and at most twice the swept area where the segment turns
    about a point between its ends. A lag along a straight line sweeps nothing; `path_distances`
    measures it.

    Args:
        path_a: points `[T, 2 or 3]` [m].
        path_b: points of the same instants, in the same frame `[T, 2 or 3]` [m].

    Returns:
        The area [m^2]; 0 for a single instant.

    Raises:
        ValueError: paths that are not finite numbers, of different shapes, empty, or not 2-D or
            3-D.
    """
    a, b = _pair(path_a, path_b)
    if a.shape[1] not in (2, 3):
        raise ValueError(f"expected points of 2 or 3 coordinates, got {a.shape[1]}")
    a0, a1, b0, b1 = a[:-1], a[1:], b[:-1], b[1:]
    cut_from_b = _triangle_areas(a0, a1, b0) + _triangle_areas(a1, b1, b0)
    cut_from_a = _triangle_areas(a0, a1, b1) + _triangle_areas(a0, b1, b0)
    return float((cut_from_b + cut_from_a).sum() / 2)


def path_distances(path_a: ArrayLike, path_b: ArrayLike) -> PathDistances:
    """Return the mean and the maximum distance between the points of the same instant.

    Args:
        path_a: points `[T, D]` [m].
        path_b: points of the same instants, in the same frame `[T, D]` [m].

    Raises:
        ValueError: paths that are not finite numbers, of different shapes, or empty.
    """
    a, b = _pair(path_a, path_b)
    distances = np.linalg.norm(a - b, axis=1)  # [T]
    return PathDistances(float(distances.mean()), float(distances.max()))


def _triangle_areas(p: NDArray, q: NDArray, r: NDArray) -> NDArray:
    """Return the areas `[T]` of the triangles with corners p, q, r `[T, 2 or 3]`."""
    u, v = q - p, r - p
    if p.shape[1] == 2:
        return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    return np.linalg.norm(np.cross(u, v), axis=1) / 2


def _pair(a: ArrayLike, b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two float64 series of one shape `[T, D]`, or raise a ValueError."""
    first = finite_array("the first series", a, ("T", "D"))
    if not first.size:
        raise ValueError(f"expected series [T, D] of at least one sample, got {first.shape}")
    return first, finite_array("the second series", b, first.shape)
