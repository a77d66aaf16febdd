"""Turns of a hand for kernels: from its rotation matrix, of its slopes, between two axes."""

from __future__ import annotations

import math

from numba import njit

from pacnet.kernels.turns import norm, plus, rotate

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_SETTLING = 6  # multiplications


@njit
def nearest_turn(pose):
    """Return the turn, w ≥ 0, of a pose `[12]` whose matrix is nearly that of a rotation.

    See `turn_matrices.nearest_turns`. Each row of the form of a rotation, with the identity added,
    is the quaternion times a number; the largest row is multiplied until it settles.
    """
    a, b, c = (
        (pose[3], pose[4], pose[5]),
        (pose[6], pose[7], pose[8]),
        (pose[9], pose[10], pose[11]),
    )
    rows = (
        (1 + a[0] + b[1] + c[2], c[1] - b[2], a[2] - c[0], b[0] - a[1]),
        (c[1] - b[2], 1 + a[0] - b[1] - c[2], a[1] + b[0], a[2] + c[0]),
        (a[2] - c[0], a[1] + b[0], 1 + b[1] - a[0] - c[2], b[2] + c[1]),
        (b[0] - a[1], a[2] + c[0], b[2] + c[1], 1 + c[2] - a[0] - b[1]),
    )
    turn, largest = rows[0], rows[0][0]
    for i in range(1, 4):
        if rows[i][i] > largest:
            turn, largest = rows[i], rows[i][i]
    for _ in range(_SETTLING):
        turn = unit(turn)
        turn = (
            _dot4(rows[0], turn), _dot4(rows[1], turn), _dot4(rows[2], turn), _dot4(rows[3], turn)
        )  # fmt: skip
    turn = unit(turn)
    return turn if turn[0] >= 0 else (-turn[0], -turn[1], -turn[2], -turn[3])


@njit(inline="always")
def unit(turn):
    """Return a quaternion of length one; of none at all, no turn."""
    length = math.sqrt(_dot4(turn, turn))
    if length < 1e-12:
        return 1.0, 0.0, 0.0, 0.0
    return turn[0] / length, turn[1] / length, turn[2] / length, turn[3] / length


@njit(inline="always")
def _dot4(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@njit(inline="always")
def dot(a, b):
    """Return the inner product of vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always")
def cross(a, b):
    """Return the cross product of vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit
def spin_of(slope, hand):
    """Return the rotation vector per radian of a joint, from the slope of the hand's matrix.

    It is half of Σ R eₖ × dR eₖ over the three axes eₖ.
    """
    spin = (0.0, 0.0, 0.0)
    for k in range(3):
        axis = rotate(hand, AXES[k])
        spin = plus(spin, cross(axis, (slope[3 + k], slope[6 + k], slope[9 + k])), 0.5)
    return spin


@njit
def between(first, second):
    """Return the shortest rotation vector [rad] from one unit vector to another."""
    across = cross(first, second)
    sine = norm(across)
    angle = math.atan2(sine, dot(first, second))
    if sine > 1e-12:
        return plus((0.0, 0.0, 0.0), across, angle / sine)
    if angle < 1:
        return 0.0, 0.0, 0.0
    other = (1.0, 0.0, 0.0) if abs(first[0]) < 0.5 else (0.0, 1.0, 0.0)  # half a turn, about any
    across = cross(first, other)
    return plus((0.0, 0.0, 0.0), across, angle / norm(across))
