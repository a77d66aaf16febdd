"""Recall from motor schemas as machine code: what `MotorSchemas.recall` does by the nearest cues.

`MotorSchemas` in torch is the specification.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from pacnet.distances import ROOM, ROWS, in_whole_vectors, squared_distances
from pacnet.engine import announce_compilation
from pacnet.lanes import any_up_to, load, number_up_to, store
from pacnet.pointers import floats, integers

announce_compilation()

_NOBODY = -1  # as in `pacnet.attention`; a literal here, so that it is compiled in


class Buffers(NamedTuple):
    """The schemas' buffers, borrowed: pointers. Capacities R of the pool, N of nodes."""

    target: Any  # float32 [R * A]
    cue: Any  # float32 [R * D]
    start: Any  # int64 [N]
    length: Any  # int64 [N]
    rows: int  # R
    targets: int  # A
    cues: int  # D


@njit
def _buffers_at(table):
    """What lies where `pacnet.compiled_schemas` says."""
    return Buffers(
        target=floats(table[0]),
        cue=floats(table[1]),
        start=integers(table[2]),
        length=integers(table[3]),
        rows=table[4],
        targets=table[5],
        cues=table[6],
    )


@njit(cache=True, nogil=True)
def recall(table, nodes, percepts, nearest_cues, targets, positions):
    """Writes targets `[T, A]` and positions `[T]` of scaled percepts `[T, D]` and their winners.

    Where the winner is nobody or has no targets, the target stays as it is and the position is −1.
    """
    buffers = _buffers_at(table)
    longest = 0
    for node in nodes:
        if node != _NOBODY:
            longest = max(longest, buffers.length[node])
    room = np.zeros(in_whole_vectors(buffers.cues), np.float32)
    distances = np.empty((longest + ROWS - 1) // ROWS * ROWS, np.float32)
    last_block = np.zeros(ROWS * buffers.cues + ROOM, np.float32)
    for sample in range(len(nodes)):
        node, position = nodes[sample], _NOBODY
        if node != _NOBODY and buffers.length[node] > 0:
            for d in range(buffers.cues):
                room[d] = percepts[sample, d]
            _measure(buffers, node, room, distances, last_block)
            position = _average(buffers, node, distances, nearest_cues, targets[sample])
        positions[sample] = position


@njit
def _measure(buffers, node, room, distances, last_block):
    """Squared distances of the percept from each cue of the node's sequence."""
    percept, out = floats(room.ctypes.data), floats(distances.ctypes.data)
    start, length, dimensions = buffers.start[node], buffers.length[node], buffers.cues
    # A block may read beyond the sequence, and a vector beyond its last row, but not the pool.
    within = (buffers.rows * dimensions - ROOM) // dimensions - ROWS
    for place in range(0, length, ROWS):
        rows, at = buffers.cue, (start + place) * dimensions
        if start + place > within:
            for k in range(min(ROWS, length - place) * dimensions):
                last_block[k] = buffers.cue[at + k]
            rows, at = floats(last_block.ctypes.data), 0
        block = squared_distances(percept, rows, at, dimensions, np.float32(np.inf))
        store(out, place, block)
    for place in range(length, (length + ROWS - 1) // ROWS * ROWS):
        distances[place] = np.inf  # of nobody


@njit
def _average(buffers, node, distances, nearest_cues, target):
    """Writes the mean of the nearest targets `[A]`; returns the position of the nearest cue."""
    start, length = buffers.start[node], buffers.length[node]
    number = min(nearest_cues, length)
    limit, equal = _limit_of(distances, length, number)
    values = floats(distances.ctypes.data)
    total = np.zeros(buffers.targets, np.float64)
    nearest = _NOBODY
    for first in range(0, length, ROWS):
        if not any_up_to(load(values, first, ROWS), limit):
            continue
        for place in range(first, min(first + ROWS, length)):
            equal -= values[place] == limit  # of equal ones the first count
            if values[place] < limit or (values[place] == limit and equal >= 0):
                if nearest == _NOBODY or values[place] < values[nearest]:
                    nearest = place
                at = (start + place) * buffers.targets
                for a in range(buffers.targets):
                    total[a] += buffers.target[at + a]
    for a in range(buffers.targets):
        target[a] = total[a] / number
    return nearest


@njit
def _limit_of(distances, length, number):
    """How far the nearest so many reach, and how many of those at the very limit are of them.

    Bisection, for floats ≥ 0 are ordered as their bits: to count some twenty times, on vectors and
    without a branch, is faster than to sort.
    """
    near, far = np.int64(0), np.int64(np.float32(np.inf).view(np.int32))
    while near < far:
        middle = (near + far) // 2
        within = _count(distances, length, middle)
        if within == number:
            return _float(middle), number
        if within > number:
            far = middle
        else:
            near = middle + 1
    return _float(far), number - _count(distances, length, far - 1)


@njit
def _count(distances, length, bits):
    values, limit, within = floats(distances.ctypes.data), _float(bits), 0
    for first in range(0, length, ROWS):
        within += number_up_to(load(values, first, ROWS), limit)
    return within


@njit
def _float(bits):
    return np.int32(bits).view(np.float32)
