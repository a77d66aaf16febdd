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


def aligned_distance(reference: ArrayLike, path: ArrayLike) -> float:
    """Return the mean distance of a path from a reference, whatever the pace of either.

    Of all alignments that keep the order of both and leave out no point, that with the smallest sum
    of distances is taken (dynamic time warping; Sakoe & Chiba 1978, without slope constraint). Each
    point of the reference counts once, with its mean distance from the points aligned with it: a
    path that waits somewhere is neither better nor worse for that.

    Args:
        reference: points `[S, D]` [m].
        path: points in the same frame `[T, D]` [m].

    Raises:
        ValueError: paths that are not finite numbers, of different dimensions, or empty.
    """
    a = _series("the reference", reference)
    b = finite_array("the path", path, ("T", a.shape[1]))
    if not b.size:
        raise ValueError(f"expected a path of at least one sample, got {b.shape}")
    squares = [np.subtract.outer(x, y) ** 2 for x, y in zip(a.T, b.T, strict=True)]
    distances = np.sqrt(np.sum(squares, axis=0))  # [S, T]
    rows, columns = _alignment(distances)
    sums = np.bincount(rows, distances[rows, columns])
    return float((sums / np.bincount(rows)).mean())


def _alignment(distances: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the pairs, in order, whose distances `[S, T]` sum to least."""
    sums = _least_sums(distances)
    row, column = distances.shape
    pairs = []
    while row and column:
        pairs.append((row - 1, column - 1))
        before = ((row - 1, column - 1), (row - 1, column), (row, column - 1))
        row, column = min(before, key=sums.item)  # straight ahead where they are equal
    rows, columns = np.array(pairs[::-1]).T
    return rows, columns


def _least_sums(distances: NDArray) -> NDArray:
    """Return the least sum of an alignment up to each pair, with a border `[S + 1, T + 1]`."""
    count, steps = distances.shape
    sums = np.full((count + 1, steps + 1), np.inf)
    sums[0, 0] = 0.0
    sums[1:, 1:] = distances
    flat, width = sums.reshape(-1), steps + 1
    for total in range(2, count + steps + 1):  # row + column: one diagonal at a time
        first = max(1, total - steps) * steps + total  # its first and last place in `flat`
        last = min(count, total - 1) * steps + total
        straight, above, left, here = (
            flat[first - back : last - back + 1 : steps] for back in (width + 1, width, 1, 0)
        )
        here += np.minimum(straight, np.minimum(above, left))
    return sums


def _triangle_areas(p: NDArray, q: NDArray, r: NDArray) -> NDArray:
    """Return the areas `[T]` of the triangles with corners p, q, r `[T, 2 or 3]`."""
    u, v = q - p, r - p
    if p.shape[1] == 2:
        return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    return np.linalg.norm(np.cross(u, v), axis=1) / 2


def _pair(a: ArrayLike, b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two float64 series of one shape `[T, D]`, or raise a ValueError."""
    first = _series("the first series", a)
    return first, finite_array("the second series", b, first.shape)


def _series(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return a float64 series `[T, D]` of one sample or more, or raise a ValueError."""
    series = finite_array(name, values, ("T", "D"))
    if not series.size:
        raise ValueError(f"expected series [T, D] of at least one sample, got {series.shape}")
    return series
