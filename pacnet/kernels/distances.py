"""Squared Euclidean distances of a percept from rows, for kernels.

Everything that compares a percept with prototypes or cues calls `squared_distances`, so that a
distance depends on the two points alone: not on a row's index, the number of rows, or how many
percepts are read at once.

Numba's cache of a kernel depends on the kernel's own file alone: after a change of this file,
`make clean` has the kernels of other files compiled again.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pacnet.kernels.caching import cached_njit

_CHUNK = 512  # rows whose sums stay in the nearest cache
_INFINITE = np.float32(np.finfo(np.float32).max)  # more than any squared distance


# Without `nogil`: reacquiring the lock while another thread learns would take longer.
@cached_njit(fastmath={"contract"}, error_model="numpy")
def squared_distances(percepts, number, columns, first, count, out):
    """Write the squared distances of one of several percepts from a range of rows.

    Four dimensions are added for all rows in one go, always in the same order, so that the rows'
    sums lie side by side in vector registers. A product and its sum are rounded together where the
    processor can.

    Args:
        percepts: finite, `[B, D]`.
        number: index of the percept.
        columns: the rows, finite, of the same dtype, transposed, `[D, N]`.
        first: the first row.
        count: number of rows, ≤ N − first.
        out: where to write, `[count]` or longer.

    Returns:
        The nearest and the second nearest row, counted from the first; ties go to the lowest index;
        −1 where there is none.
    """
    dimensions, whole = len(columns), len(columns) // 4 * 4
    for begin in range(0, count, _CHUNK):
        size = min(_CHUNK, count - begin)
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
    least = second = _INFINITE
    winner = runner_up = -1
    for index in range(count):
        value = values[index]
        if value < second:
            if value < least:
                least, second, winner, runner_up = value, least, index, winner
            else:
                second, runner_up = value, index
    return winner, runner_up


def distances_of(percept: NDArray[np.floating], rows: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the distances `[N]` of a finite percept `[D]` from rows `[N, D]` of the same dtype.

    Rows in column-major order (`np.asfortranarray`) are not copied.

    Raises:
        ValueError: a percept of another length or dtype than the rows.
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
