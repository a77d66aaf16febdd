"""For kernels: squared Euclidean distances of a percept from rows.

Everything that compares a percept with prototypes or cues calls `squared_distances`, so that a
distance depends on nothing but the two points: not on where the row lies, how many there are, or
how many percepts are read at once.

Numba keeps a compiled kernel as long as its own file is unchanged: after a change of this file,
`make clean` has those of other files compiled anew.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pacnet.kernels.engine import announce_compilation

announce_compilation()

_TOGETHER = 512  # rows whose sums stay in the nearest cache
_FAR = np.float32(np.finfo(np.float32).max)  # more than any squared distance


# It keeps the interpreter: to get it back from a thread that learns would take longer.
@njit(cache=True, fastmath={"contract"}, error_model="numpy")
def squared_distances(percepts, number, columns, first, count, out):
    """Writes the squared distances of one of several percepts from some of several rows.

    Each dimension is taken for all of them at once, four dimensions in one go, so that they are
    added side by side in vector registers, always in the same order. A product is rounded together
    with its sum, where the processor can.

    Args:
        percepts: finite, `[B, D]`.
        number: of the percept among them.
        columns: the rows' dimensions, finite, of the same dtype, `[D, N]`.
        first: the first of the rows.
        count: how many rows, ≤ N − first.
        out: where to write, `[count]` or longer.

    Returns:
        The nearest and the second nearest of them, counted from the first; of equally near ones the
        first; −1 where there is none.
    """
    dimensions, whole = len(columns), len(columns) // 4 * 4
    for begin in range(0, count, _TOGETHER):
        size = min(_TOGETHER, count - begin)
        at, squared = first + begin, out[begin : begin + size]
        for row in range(size):
            squared[row] = 0
        for k in range(0, whole, 4):
            xa, xb, xc, xd = (
                percepts[number, k], percepts[number, k + 1], percepts[number, k + 2],
                percepts[number, k + 3],
            )  # fmt: skip
            a, b = columns[k, at : at + size], columns[k + 1, at : at + size]
            c, d = columns[k + 2, at : at + size], columns[k + 3, at : at + size]
            for row in range(size):
                aa, bb, cc, dd = a[row] - xa, b[row] - xb, c[row] - xc, d[row] - xd
                squared[row] = (((squared[row] + aa * aa) + bb * bb) + cc * cc) + dd * dd
        for k in range(whole, dimensions):
            xa, a = percepts[number, k], columns[k, at : at + size]
            for row in range(size):
                squared[row] += (a[row] - xa) * (a[row] - xa)
    return _two_least(out, count)


@njit
def _two_least(values, count):
    least = second = _FAR
    winner = runner_up = -1
    for place in range(count):
        value = values[place]
        if value < second:
            if value < least:
                least, second, winner, runner_up = value, least, place, winner
            else:
                second, runner_up = value, place
    return winner, runner_up


def distances_of(percept: NDArray[np.floating], rows: NDArray[np.floating]) -> NDArray[np.floating]:
    """Distances `[N]` of a finite percept `[D]` from rows `[N, D]`, both of one dtype.

    Rows whose dimensions lie apart (`np.asfortranarray`) are not copied.

    Raises:
        ValueError: a percept of another width or dtype than the rows.
    """
    if percept.shape != rows.shape[1:] or percept.dtype != rows.dtype:
        raise ValueError(
            f"expected a percept {list(rows.shape[1:])} of {rows.dtype}, as the rows, "
            f"got {list(percept.shape)} of {percept.dtype}"
        )
    out = np.empty(len(rows), rows.dtype)
    one, columns = np.ascontiguousarray(percept)[None], np.ascontiguousarray(rows.T)
    squared_distances(one, 0, columns, 0, len(rows), out)
    return np.sqrt(out)
