"""Recall from motor schemas as machine code: what `MotorSchemas.recall` does by the nearest cues.

`MotorSchemas` in torch is the specification. What a kernel calls stands in this same file: numba's
cache would not notice a change elsewhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import carray, njit
from numpy.typing import NDArray

from pacnet.engine import announce_compilation
from pacnet.pointers import floats, integers

announce_compilation()

_NOBODY = -1  # as in `pacnet.attention`; a literal here, so that it is compiled in


class SchemaArrays(NamedTuple):
    """The schemas' buffers, borrowed: the same memory. Capacities R of the pool, N of nodes."""

    target: NDArray[np.float32]  # [R, A]
    cue: NDArray[np.float32]  # [R, D]
    start: NDArray[np.int64]  # [N]
    length: NDArray[np.int64]  # [N]


@njit
def _arrays_at(table):
    """The buffers, where `pacnet.compiled_schemas` says that they lie."""
    rows, nodes, targets, cues = table[4], table[5], table[6], table[7]
    return SchemaArrays(
        target=carray(floats(table[0]), (rows, targets)),
        cue=carray(floats(table[1]), (rows, cues)),
        start=carray(integers(table[2]), (nodes,)),
        length=carray(integers(table[3]), (nodes,)),
    )


@njit(cache=True, nogil=True)
def recall_one(table, node, percept, nearest_cues, target):
    """Writes the target of one scaled percept `[D]` into `[A]`; returns its position, or −1."""
    return _recall(_arrays_at(table), node, percept, nearest_cues, target)


@njit(cache=True, nogil=True)
def recall(table, nodes, percepts, nearest_cues, targets, positions):
    """Writes targets `[T, A]` and positions `[T]` of scaled percepts `[T, D]` and their winners.

    Where the winner is nobody or has no targets, the target stays as it is and the position is −1.
    """
    arrays = _arrays_at(table)
    for sample in range(len(nodes)):
        positions[sample] = _recall(
            arrays, nodes[sample], percepts[sample], nearest_cues, targets[sample]
        )


@njit
def _recall(arrays, node, percept, nearest_cues, target):
    if node == _NOBODY or arrays.length[node] == 0:
        return _NOBODY
    start, length = arrays.start[node], arrays.length[node]
    cues, targets = arrays.cue[start : start + length], arrays.target[start : start + length]
    distance, nearest = np.empty(length, np.float32), 0
    for place in range(length):
        distance[place] = _squared_distance(percept, cues[place])
        if distance[place] < distance[nearest]:
            nearest = place
    if nearest_cues == 1:
        target[:] = targets[nearest]
    else:
        _average(targets, distance, min(nearest_cues, length), target)
    return nearest


@njit
def _average(targets, distance, number, target):
    """The mean of the nearest targets; of those equally near as the last, the first ones count."""
    last = np.partition(distance, number - 1)[number - 1]
    equal = number
    for place in range(len(distance)):
        equal -= distance[place] < last
    total = np.zeros(targets.shape[1], np.float64)
    for place in range(len(distance)):
        if distance[place] < last or (distance[place] == last and equal > 0):
            equal -= distance[place] == last
            for a in range(len(total)):
                total[a] += targets[place, a]
    for a in range(len(total)):
        target[a] = total[a] / number


@njit(fastmath={"reassoc", "contract", "nsz"})
def _squared_distance(percept, cue):
    """Summed in any order, which is what lets it run on vectors."""
    total = np.float32(0)
    for d in range(len(percept)):
        difference = percept[d] - cue[d]
        total += difference * difference
    return total
