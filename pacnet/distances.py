"""For kernels: squared Euclidean distances of a percept from rows that lie one after the other.

Eight rows are compared at once. Each row is summed in the same order wherever it lies, so that a
distance depends on nothing but the two points.

Numba keeps compiled kernels as long as their own file is unchanged: after a change of this file, of
`pacnet.lanes` or of `pacnet.pointers`, `make clean` has them compiled anew.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pacnet.lanes import (
    add_product,
    any_up_to,
    difference,
    first_ones,
    load,
    sums,
    total,
    zeros,
)

ROWS = 8  # compared at once
_FEW, _MANY = 8, 16  # dimensions taken at once, by whether there are more than a few
ROOM = _MANY  # numbers behind the percept and behind the rows that may be read, and count nothing


@njit
def in_whole_vectors(dimensions):
    """Room that a percept needs."""
    return (dimensions + ROOM - 1) // ROOM * ROOM


@njit(forceinline=True)
def squared_distances(percept, rows, at, dimensions, limit):
    """Of a percept `[D]` from the eight rows `[D]` at `at`, side by side; all are pointers.

    If none of them is up to a limit, it may be a part of each sum that is beyond it already.
    """
    if dimensions > _FEW:
        return _from_eight_of_many(percept, rows, at, dimensions, limit)
    return _from_eight_of_few(percept, rows, at, dimensions, limit)


@njit(forceinline=True)
def squared_distance(percept, rows, at, dimensions):
    """Of a percept `[D]` from the row at `at`."""
    if dimensions > _FEW:
        return _from_one_of_many(percept, rows, at, dimensions)
    return _from_one_of_few(percept, rows, at, dimensions)


def _make(lanes):  # noqa: C901 - four functions, each of them simple
    """The two functions for so many dimensions at once.

    Args:
        lanes: dimensions taken at once.
    """

    @njit(forceinline=True)
    def from_eight(percept, rows, at, length, limit):
        a, b, c, d = zeros(lanes), zeros(lanes), zeros(lanes), zeros(lanes)
        e, f, g, h = zeros(lanes), zeros(lanes), zeros(lanes), zeros(lanes)
        whole = length // lanes * lanes
        for k in range(0, whole, lanes):
            x, here = load(percept, k, lanes), at + k
            a = add_square(a, rows, here, x)
            b = add_square(b, rows, here + length, x)
            c = add_square(c, rows, here + 2 * length, x)
            d = add_square(d, rows, here + 3 * length, x)
            e = add_square(e, rows, here + 4 * length, x)
            f = add_square(f, rows, here + 5 * length, x)
            g = add_square(g, rows, here + 6 * length, x)
            h = add_square(h, rows, here + 7 * length, x)
            if k == 0 and lanes < length and limit < np.inf:
                so_far = sums(a, b, c, d, e, f, g, h)
                if not any_up_to(so_far, limit):
                    return so_far
        if whole < length:
            x, here, rest = load(percept, whole, lanes), at + whole, length - whole
            a = add_last_square(a, rows, here, x, rest)
            b = add_last_square(b, rows, here + length, x, rest)
            c = add_last_square(c, rows, here + 2 * length, x, rest)
            d = add_last_square(d, rows, here + 3 * length, x, rest)
            e = add_last_square(e, rows, here + 4 * length, x, rest)
            f = add_last_square(f, rows, here + 5 * length, x, rest)
            g = add_last_square(g, rows, here + 6 * length, x, rest)
            h = add_last_square(h, rows, here + 7 * length, x, rest)
        return sums(a, b, c, d, e, f, g, h)

    @njit(forceinline=True)
    def from_one(percept, rows, at, length):
        squares, whole = zeros(lanes), length // lanes * lanes
        for k in range(0, whole, lanes):
            squares = add_square(squares, rows, at + k, load(percept, k, lanes))
        if whole < length:
            x, rest = load(percept, whole, lanes), length - whole
            squares = add_last_square(squares, rows, at + whole, x, rest)
        return total(squares)

    @njit(forceinline=True)
    def add_square(squares, rows, at, x):
        apart = difference(load(rows, at, lanes), x)
        return add_product(squares, apart, apart)

    @njit(forceinline=True)
    def add_last_square(squares, rows, at, x, rest):
        apart = first_ones(difference(load(rows, at, lanes), x), rest)
        return add_product(squares, apart, apart)

    return from_eight, from_one


_from_eight_of_few, _from_one_of_few = _make(_FEW)
_from_eight_of_many, _from_one_of_many = _make(_MANY)
