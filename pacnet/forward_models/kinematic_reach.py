"""The posture nearest to another that takes the hand to a place."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from pacnet.forward_models.kinematic_arrays import KinematicArrays, Reach
from pacnet.forward_models.kinematic_kernels import make_work, pose_at, reach

Array = NDArray[np.float64]

_STEPS = 60  # of each search
_PULLS = (3e-2, 3e-3, 3e-4, 0.0)  # towards the posture to stay near, one search after the other
_NEAR = 1e-3  # of the extent of the places; a search that leaves no more has arrived
_RESTARTS = 12
_UNHELD = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)


def nearest_posture(
    arrays: KinematicArrays, near: Array, place: Array, turn: Array | None
) -> Reach:
    """Return the posture nearest to another that takes the hand there, or as near as it gets.

    The search begins at the posture, which draws it more and more weakly. One that does not arrive
    begins again at those postures with each joint at an end or in the middle of its range in which
    the hand is nearest, one after the other.

    Args:
        arrays: of the model.
        near: `[J]` [rad].
        place: `[3]`.
        turn: unit quaternion `[4]`; None for any.
    """
    starts = _grid(arrays, near)
    poses = [pose_at(arrays, start) for start in starts]
    places = np.array([pose[0] for pose in poses])
    extent = max(float(np.linalg.norm(places.std(axis=0))), 1e-12)
    square = np.square(places - place).sum(axis=1)
    if turn is not None:
        cosine = np.abs(np.array([pose[1] for pose in poses]) @ turn).clip(max=1)
        square += np.square(2 * extent * np.arccos(cosine))
    found = _search(arrays, near, near, place, turn, extent)
    for start in starts[np.argsort(square, kind="stable")[:_RESTARTS]]:
        if _left(found, extent) <= _NEAR * extent:
            break
        other = _search(arrays, start, near, place, turn, extent)
        found = min(found, other, key=lambda one: _left(one, extent))
    return found


def _left(found: Reach, extent: float) -> float:
    """Return what a search left of the way, a radian counted as the extent of the places."""
    return float(np.hypot(found.distance, extent * found.turn))


def _search(
    arrays: KinematicArrays,
    start: Array,
    near: Array,
    place: Array,
    turn: Array | None,
    extent: float,
) -> Reach:
    """Return where the search from one posture ends."""
    angles, work = start.copy(), make_work(arrays)
    weight = 0.0 if turn is None else extent
    wanted = (1.0, 0.0, 0.0, 0.0) if turn is None else tuple(turn.tolist())
    distance = off = 0.0
    for pull in _PULLS:
        distance, off = reach(
            arrays, angles, near, *_UNHELD, tuple(place.tolist()), wanted, False,
            (weight, pull * extent, _STEPS), work,
        )  # fmt: skip
    return Reach(angles, float(distance), float(off) if turn is not None else 0.0)


def _grid(arrays: KinematicArrays, near: Array) -> Array:
    """Return postures with each joint that moves the hand at an end or in the middle, `[P, J]`."""
    low, high = arrays.lowest[arrays.moving], arrays.highest[arrays.moving]
    ends = np.stack([low, (low + high) / 2, high], axis=1)
    chosen = np.array(list(itertools.product(*ends)))
    postures = np.repeat(near[None], len(chosen), axis=0)
    postures[:, arrays.moving] = chosen
    return postures
