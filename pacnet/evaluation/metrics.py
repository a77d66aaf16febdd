"""Measures of how well an imitation matches a demonstration: pure functions from arrays to values.

The paper compares two wrist paths by eye (Figure 7) and proposes the area between the curves; here
it is, with distances of the wrists, errors of the joints, and the order in which nodes win.
"""

from __future__ import annotations

from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class PathDistances(NamedTuple):
    """Distances between the points of the same instant on two paths [m]."""

    mean: float
    maximum: float


class JointRMS(NamedTuple):
    """Root mean square differences of joint angles [degrees]."""

    whole: float  # over all joints and instants
    per_joint: tuple[float, ...]  # [J]


def area_between_curves(path_a: ArrayLike, path_b: ArrayLike) -> float:
    """Area swept by the segment that joins the two points of the same instant.

    Between two instants that segment sweeps a strip of a ruled surface with the corners
    a_t, a_t+1, b_t+1, b_t. Either diagonal cuts the strip into two triangles; the mean of both
    cuts is taken, so that neither path is preferred:

        area = sum_t (|a_t a_t+1 b_t| + |a_t+1 b_t+1 b_t| + |a_t a_t+1 b_t+1| + |a_t b_t+1 b_t|) / 2

    with |pqr| = |(q - p) x (r - p)| / 2. The area counts without sign and as often as it is swept.
    It is exact for flat convex strips, and at most twice the swept area where the two points move
    to opposite sides of the segment, so that it turns about a point within. A lag along a straight
    line sweeps nothing; `path_distances` sees it.

    Args:
        path_a: Points [T, 2 or 3] [m].
        path_b: Points of the same instants, in the same frame [T, 2 or 3] [m].

    Returns:
        The area [m^2]; 0 for a single instant.

    Raises:
        ValueError: Paths that are not finite numbers, not alike in shape, empty, or not 2-D or 3-D.
    """
    a, b = _pair(path_a, path_b)
    if a.shape[1] not in (2, 3):
        raise ValueError(f"expected points of 2 or 3 coordinates, got {a.shape[1]}")
    a0, a1, b0, b1 = a[:-1], a[1:], b[:-1], b[1:]
    cut_from_b = _triangle_areas(a0, a1, b0) + _triangle_areas(a1, b1, b0)
    cut_from_a = _triangle_areas(a0, a1, b1) + _triangle_areas(a0, b1, b0)
    return float((cut_from_b + cut_from_a).sum() / 2)


def path_distances(path_a: ArrayLike, path_b: ArrayLike) -> PathDistances:
    """Mean and maximum distance between the points of the same instant.

    Args:
        path_a: Points [T, D] [m].
        path_b: Points of the same instants, in the same frame [T, D] [m].

    Raises:
        ValueError: Paths that are not finite numbers, not alike in shape, or empty.
    """
    a, b = _pair(path_a, path_b)
    distances = np.linalg.norm(a - b, axis=1)  # [T]
    return PathDistances(float(distances.mean()), float(distances.max()))


def joint_rms(angles_a: ArrayLike, angles_b: ArrayLike) -> JointRMS:
    """Root mean square difference of joint angles, in degrees.

    Angles are taken as they are, not wrapped: the joints are hinges with limits.

    Args:
        angles_a: Joint angles [T, J] [rad].
        angles_b: Joint angles of the same instants [T, J] [rad].

    Raises:
        ValueError: Angles that are not finite numbers, not alike in shape, or empty.
    """
    a, b = _pair(angles_a, angles_b)
    squares = np.degrees(a - b) ** 2  # [T, J]
    per_joint = np.sqrt(squares.mean(axis=0)).tolist()
    return JointRMS(float(np.sqrt(squares.mean())), tuple(per_joint))


def winner_order(winners: ArrayLike, min_run: int = 3) -> tuple[int, ...]:
    """Order in which nodes won, without flicker and without repeats.

    First the samples that nobody won (negative) are left out; then every run of one winner shorter
    than `min_run` is dropped, as it stands; only then are neighbouring runs of one winner merged:

        A A A A B A A A A    -> (A,)
        A A A A B A B B B B  -> (A, B): the inner B and A are runs of one sample each

    Args:
        winners: Index of the winner at each sample, negative for none [T].
        min_run: Fewest samples in a row that count as winning.

    Raises:
        ValueError: Winners that are not a sequence of integers, or a `min_run` below 1.
    """
    if min_run < 1:
        raise ValueError(f"expected min_run ≥ 1 sample, got {min_run}")
    runs = [(node, len(list(run))) for node, run in groupby(_won(winners))]
    lasting = [node for node, length in runs if length >= min_run]
    return tuple(node for node, _ in groupby(lasting))


def order_agreement(order_a: ArrayLike, order_b: ArrayLike) -> float:
    """Agreement of two orders of winners, from 0 to 1.

    The length of their longest common subsequence over the length of the longer one.

    Args:
        order_a: Nodes in the order in which they won, as `winner_order` gives them.
        order_b: The same of another episode.

    Returns:
        The agreement; 1 for two empty orders.

    Raises:
        ValueError: Orders that are not sequences of integers.
    """
    a, b = _integers(order_a, "an order"), _integers(order_b, "an order")
    if not (a or b):
        return 1.0
    longest = [0] * (len(b) + 1)  # of the part of a read so far and each beginning of b
    for node in a:
        previous = longest
        longest = [0]
        for index, other in enumerate(b):
            extended = previous[index] + 1 if node == other else 0
            longest.append(max(extended, previous[index + 1], longest[index]))
    return longest[-1] / max(len(a), len(b))


def switches(winners: ArrayLike) -> int:
    """Number of changes from one winner to the next, flicker included.

    Samples that nobody won (negative) are left out: A, none, A is no change; A, none, B is one.

    Args:
        winners: Index of the winner at each sample, negative for none [T].

    Raises:
        ValueError: Winners that are not a sequence of integers.
    """
    return max(sum(1 for _ in groupby(_won(winners))) - 1, 0)


def area_under_roc(known: ArrayLike, new: ArrayLike) -> float:
    """How well a score tells the new from the known.

    The chance that a new one has the higher score of a random pair, half a chance where both are
    equal: the area under the receiver operating characteristic (Hanley & McNeil 1982).

    Args:
        known: scores [N] of what is known.
        new: scores [M] of what is new.

    Returns:
        From 0 to 1; 0.5 tells nothing.

    Raises:
        ValueError: Scores that are not one or more finite numbers.
    """
    below, above = np.sort(_scores(known, "known")), _scores(new, "new")
    wins = np.searchsorted(below, above, "left") + np.searchsorted(below, above, "right")
    return float(wins.mean() / (2 * len(below)))


def _triangle_areas(p: NDArray, q: NDArray, r: NDArray) -> NDArray:
    """Areas [T] of the triangles with corners p, q, r [T, 2 or 3]."""
    u, v = q - p, r - p
    if p.shape[1] == 2:
        return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    return np.linalg.norm(np.cross(u, v), axis=1) / 2


def _pair(a: ArrayLike, b: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two [T, D] series of the same instants in float64, or a ValueError."""
    first, second = _series(a), _series(b)
    if first.shape != second.shape:
        raise ValueError(f"expected two series of one shape, got {first.shape} and {second.shape}")
    return first, second


def _series(value: ArrayLike) -> NDArray[np.float64]:
    """A finite [T, D] array with T and D at least 1 in float64, or a ValueError."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"expected real numbers, got {array.dtype}")
    if array.ndim != 2 or 0 in array.shape:
        raise ValueError(f"expected a series [T, D] of at least one sample, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("expected finite numbers, got NaN or infinity")
    return array.astype(np.float64)


def _won(winners: ArrayLike) -> list[int]:
    """The winners of the samples that somebody won."""
    return [node for node in _integers(winners, "winners") if node >= 0]


def _integers(value: ArrayLike, name: str) -> list[int]:
    """A sequence of integers as a list, or a ValueError."""
    array = np.asarray(value)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(f"expected {name} as integers [T], got {array.dtype} {array.shape}")
    return array.tolist()


def _scores(value: ArrayLike, name: str) -> NDArray[np.float64]:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim != 1 or not len(array) or not np.isfinite(array).all():
        raise ValueError(f"expected {name} as one or more finite numbers, got shape {array.shape}")
    return array
