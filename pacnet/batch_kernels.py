"""For kernels: the two nearest rows of sixteen percepts at once, side by side.

Faster than one percept after the other, for a row is read once for sixteen and nothing is added
across lanes. Each distance is summed in the very order of `pacnet.distances`, to the same bits.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pacnet.distances import ROOM
from pacnet.lanes import (
    add_product,
    added,
    difference,
    fill,
    filled,
    load,
    store,
    where_less,
    zeros,
)

TOGETHER = 16  # percepts
MOST_ROWS = 2**24  # whose numbers float32 tells apart


@njit
def two_nearest_of_each(percepts, prototype, nodes, dimensions, row, found):
    """Writes winners, runners-up and squared distances of the winners: `[3, TOGETHER]`.

    All but the numbers are pointers to float32; a number of −1 stands for nobody.

    Args:
        percepts: `[D in whole vectors, TOGETHER]`, zeros behind the last dimension.
        prototype: the rows `[nodes, D]`.
        nodes: number of rows, at most `MOST_ROWS`.
        dimensions: D.
        row: room for one, `[D in whole vectors]`, zeros behind the last dimension.
        found: where to write.
    """
    nearest, winner = filled(np.float32(np.inf), TOGETHER), filled(np.float32(-1), TOGETHER)
    second, runner_up = nearest, winner
    for node in range(nodes):
        for d in range(dimensions):
            row[d] = prototype[node * dimensions + d]
        number = filled(np.float32(node), TOGETHER)
        squares = _squared_distances(percepts, row, dimensions)
        other = where_less(squares, second, number, runner_up)
        runner_up = where_less(squares, nearest, winner, other)
        other = where_less(squares, second, squares, second)
        second = where_less(squares, nearest, nearest, other)
        winner = where_less(squares, nearest, number, winner)
        nearest = where_less(squares, nearest, squares, nearest)
    store(found, 0, winner)
    store(found, TOGETHER, runner_up)
    store(found, 2 * TOGETHER, nearest)


@njit(forceinline=True)
def _squared_distances(percepts, row, dimensions):
    """Of the percepts from a row: as many sums as `pacnet.distances` has lanes, and then theirs."""
    s0, s1, s2, s3 = zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER)
    s4, s5, s6, s7 = zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER)
    s8, s9, s10, s11 = zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER)
    s12, s13, s14, s15 = zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER), zeros(TOGETHER)
    for k in range(0, dimensions, ROOM):
        s0 = _add_square(s0, percepts, row, k + 0)
        s1 = _add_square(s1, percepts, row, k + 1)
        s2 = _add_square(s2, percepts, row, k + 2)
        s3 = _add_square(s3, percepts, row, k + 3)
        s4 = _add_square(s4, percepts, row, k + 4)
        s5 = _add_square(s5, percepts, row, k + 5)
        s6 = _add_square(s6, percepts, row, k + 6)
        s7 = _add_square(s7, percepts, row, k + 7)
        s8 = _add_square(s8, percepts, row, k + 8)
        s9 = _add_square(s9, percepts, row, k + 9)
        s10 = _add_square(s10, percepts, row, k + 10)
        s11 = _add_square(s11, percepts, row, k + 11)
        s12 = _add_square(s12, percepts, row, k + 12)
        s13 = _add_square(s13, percepts, row, k + 13)
        s14 = _add_square(s14, percepts, row, k + 14)
        s15 = _add_square(s15, percepts, row, k + 15)
    a = _four(added(s0, s8), added(s1, s9), added(s2, s10), added(s3, s11))
    b = _four(added(s4, s12), added(s5, s13), added(s6, s14), added(s7, s15))
    return added(a, b)


@njit(forceinline=True)
def _add_square(total, percepts, row, d):
    apart = difference(fill(row, d, TOGETHER), load(percepts, d * TOGETHER, TOGETHER))
    return add_product(total, apart, apart)


@njit(forceinline=True)
def _four(a, b, c, d):
    return added(added(a, b), added(c, d))
