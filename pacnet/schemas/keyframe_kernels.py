"""Kernels that find keyframes, and fit what is between them."""

from __future__ import annotations

import math

import numpy as np

from pacnet.kernels.caching import cached_njit


@cached_njit(nogil=True)
def measure_importance(rows, frame, importance):
    """Write how far each row is from the line between its neighbours; see `keyframes.importance`.

    Args:
        rows: `[T, D]`.
        frame: number of each, ascending, `[T]`.
        importance: where to write, `[T]`, zeros.
    """
    last = len(rows) - 1
    importance[0] = importance[last] = math.inf
    begins, ends = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    begins[0], ends[0], waiting = 0, last, 1
    while waiting > 0:
        waiting -= 1
        begin, end = begins[waiting], ends[waiting]
        most, where = 0.0, -1
        for row in range(begin + 1, end):
            share, apart = (frame[row] - frame[begin]) / (frame[end] - frame[begin]), 0.0
            for d in range(rows.shape[1]):
                line = (1 - share) * rows[begin, d] + share * rows[end, d]
                apart += (rows[row, d] - line) ** 2
            if apart > most:
                most, where = apart, row
        if where >= 0:
            least = min(importance[begin], importance[end])
            importance[where] = min(least, math.sqrt(most))
            begins[waiting], ends[waiting] = begin, where
            begins[waiting + 1], ends[waiting + 1] = where, end
            waiting += 2


@cached_njit(nogil=True)
def fit_lines(rows, kept, fitted):
    """Write the values at kept rows whose interpolation is nearest to all rows in between.

    The normal equations of this least-squares problem are tridiagonal.

    Args:
        rows: `[T, A]`.
        kept: numbers of K ≥ 2 rows, ascending, `[K]`; what is outside them does not count.
        fitted: where to write, `[K, A]`, zeros.
    """
    count = len(kept)
    middle, beside = np.zeros(count), np.zeros(count)
    for k in range(count - 1):
        first, end = kept[k], kept[k + 1]
        for row in range(first, end + 1 if k == count - 2 else end):
            share = (row - first) / (end - first)
            middle[k] += (1 - share) ** 2
            middle[k + 1] += share**2
            beside[k] += share * (1 - share)
            for a in range(rows.shape[1]):
                fitted[k, a] += (1 - share) * rows[row, a]
                fitted[k + 1, a] += share * rows[row, a]
    for k in range(1, count):
        ratio = beside[k - 1] / middle[k - 1]
        middle[k] -= ratio * beside[k - 1]
        fitted[k] -= ratio * fitted[k - 1]
    fitted[count - 1] /= middle[count - 1]
    for k in range(count - 2, -1, -1):
        fitted[k] = (fitted[k] - beside[k] * fitted[k + 1]) / middle[k]
