"""Kernels of recall by the nearest cue."""

from __future__ import annotations

import numpy as np
from numba import njit

from pacnet.kernels.caching import cached_njit
from pacnet.kernels.distances import squared_distances

_NO_NODE = -1  # `pacnet.attention.records.NO_NODE`, as a literal so that it is compiled in


@cached_njit()
def recall(  # noqa: C901 - checks and loops, none of them deep
    nodes, percepts, start, length, cue, target, nearest_cues, targets, offsets
):
    """Write targets `[T, A]` and offsets `[T]`; return whether all indices are in range.

    Args:
        nodes: the winners, or −1, `[T]`.
        percepts: finite, of the cues' dtype, `[T, D]`.
        start: first row of each node's sequence, `[N]`.
        length: number of its rows, `[N]`.
        cue: by dimension, `[D, R]`.
        target: `[R, A]`.
        nearest_cues: number of nearest cues whose targets are averaged.
        targets: the output; unchanged where there is no winner or it has no targets.
        offsets: the output; −1 there.
    """
    longest = 0
    for node in nodes:
        if node != _NO_NODE:
            if not 0 <= node < len(length):
                return False
            longest = max(longest, length[node])
    rows = cue.shape[1]
    if longest > rows or percepts.shape[1] != len(cue) or len(target) < rows:
        return False
    distances = np.empty(longest, cue.dtype)
    for sample in range(len(nodes)):
        node, offsets[sample] = nodes[sample], _NO_NODE
        if node == _NO_NODE or length[node] == 0:
            continue
        first, count = start[node], length[node]
        if not (0 <= first <= first + count <= rows):
            return False
        nearest, _ = squared_distances(percepts, sample, cue, first, count, distances)
        offsets[sample] = nearest
        if nearest_cues == 1:
            for column in range(target.shape[1]):
                targets[sample, column] = target[first + nearest, column]
            continue
        _average(distances, count, min(nearest_cues, count), first, target, targets, sample)
    return True


@njit(fastmath=True)
def _average(distances, count, number, first, target, targets, sample):  # noqa: C901 - loops
    """Write the mean of the targets with the nearest cues; ties go to the lowest index.

    Bisection finds the distance of the farthest of them: counting a dozen times in vector registers
    is faster than sorting.
    """
    farthest = distances[0]
    for place in range(count):
        farthest = max(farthest, distances[place])
    half, low, high = np.float32(0.5), -np.float32(1), farthest
    within = number if number == count else -1
    while within != number:
        middle = low + (high - low) * half
        if not low < middle < high:
            break  # all beyond `low` are equally near
        few = np.float32(0)  # a float32 fills no more of a vector register
        for place in range(count):
            few += np.float32(1) if distances[place] <= middle else np.float32(0)
        within = int(few)
        if within < number:
            low = middle
        else:
            high = middle
    few = np.float32(0)
    for place in range(count):
        few += np.float32(1) if distances[place] <= low else np.float32(0)
    left, near, found = number - int(few), np.empty(number, np.int64), 0
    for place in range(count):
        if distances[place] <= high and found < number:
            beyond = distances[place] > low
            if not beyond or left > 0:
                left -= beyond
                near[found] = place
                found += 1
    for column in range(target.shape[1]):
        total = 0.0
        for place in near[:found]:
            total += target[first + place, column]
        targets[sample, column] = total / found
