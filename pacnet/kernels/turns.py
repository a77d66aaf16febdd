"""Turns for kernels: unit quaternions and vectors as tuples of floats, without arrays."""

from __future__ import annotations

import math

from numba import njit


@njit(inline="always")
def turn_of(rows, i):
    """Return a row `[4]` as a quaternion."""
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@njit(inline="always")
def vector_of(rows, i):
    """Return the first three numbers of a row as a vector."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@njit(inline="always")
def inverse(turn):
    """Return the inverse turn."""
    return turn[0], -turn[1], -turn[2], -turn[3]


@njit(inline="always")
def multiply(a, b):
    """Return the quaternion of turning by `b`, then by `a`."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@njit(inline="always")
def rotate(turn, v):
    """Return a vector turned by a quaternion."""
    w, x, y, z = turn
    a = 2 * (y * v[2] - z * v[1])
    b = 2 * (z * v[0] - x * v[2])
    c = 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * a + y * c - z * b,
        v[1] + w * b + z * a - x * c,
        v[2] + w * c + x * b - y * a,
    )


@njit
def to_vector(turn):
    """Return the rotation vector of a quaternion [rad], of up to half a turn."""
    w, x, y, z = turn
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return factor * x, factor * y, factor * z


@njit
def from_vector(v):
    """Return the quaternion of a rotation vector [rad]."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    factor = math.sin(angle / 2) / angle if angle > 1e-12 else 0.5
    return math.cos(angle / 2), factor * v[0], factor * v[1], factor * v[2]


@njit(inline="always")
def minus(a, b):
    """Return a − b of vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(inline="always")
def plus(a, b, factor):
    """Return a + factor · b of vectors."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@njit(inline="always")
def norm(v):
    """Return the length of a vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
