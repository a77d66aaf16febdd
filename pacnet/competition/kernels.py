"""Recall from motor schemas as machine code: nearest cues, the belief, and the confidences."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pacnet.competition.confidences import OUT_OF_REACH
from pacnet.kernels.distances import squared_distances
from pacnet.kernels.engine import announce_compilation

announce_compilation()

_NO_NODE = -1  # as in `pacnet.attention.records`; a literal here, so that it is compiled in


@njit(cache=True)
def recall(  # noqa: C901 - checks and loops, none of them deep
    nodes, percepts, start, length, cue, target, nearest_cues, targets, positions
):
    """Writes targets `[T, A]` and positions `[T]` of percepts `[T, D]` and their winners.

    Args:
        nodes: the winners, or nobody, `[T]`.
        percepts: finite, of the cues' dtype, `[T, D]`.
        start: the first row of each node's sequence, `[N]`.
        length: how many rows it has, `[N]`.
        cue: the cues' dimensions, `[D, R]`.
        target: `[R, A]`.
        nearest_cues: over how many of the nearest cues a target is averaged.
        targets: where to write; left as it is where there is no winner, or it has no targets.
        positions: where to write; −1 there.

    Returns:
        Whether all of these lie within one another; if not, it came back early.
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
        node, positions[sample] = nodes[sample], _NO_NODE
        if node == _NO_NODE or length[node] == 0:
            continue
        first, count = start[node], length[node]
        if not (0 <= first <= first + count <= rows):
            return False
        nearest, _ = squared_distances(percepts, sample, cue, first, count, distances)
        positions[sample] = nearest
        if nearest_cues == 1:
            for column in range(target.shape[1]):
                targets[sample, column] = target[first + nearest, column]
            continue
        _average(distances, count, min(nearest_cues, count), first, target, targets, sample)
    return True


@njit(fastmath=True)
def _average(distances, count, number, first, target, targets, sample):  # noqa: C901 - loops
    """Writes the mean of the targets with the nearest cues; of equally near ones the first count.

    The limit up to which they are near is found by bisection: to count a dozen times, side by side
    in vector registers, is faster than to sort.
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
        few = np.float32(0)  # a float32, which takes no more room in a vector register
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


@njit(cache=True)
def move_on(probability, advance, ahead):
    """Writes the belief one sample on, `[E, P]`, from that of now and the chances `[E, K]`."""
    episodes, places = probability.shape
    ahead[:] = 0.0
    for episode in range(episodes):
        now, then, end = probability[episode], ahead[episode], places - 1
        for step in range(advance.shape[1]):
            chance = advance[episode, step]
            for place in range(end - step):
                then[place + step] += chance * now[place]
            for place in range(max(0, end - step), places):
                then[end] += chance * now[place]  # at its end an episode stays
    _normalise(ahead)


@njit(cache=True)
def weigh(ahead, start, restart, rows, distances, width, mismatch, probability):
    """Writes the belief `[E, P]` after a percept, from the one before it and distances `[R]`.

    Returns:
        Whether there is a distance for each of the rows.
    """
    episodes, places = rows.shape
    for row in rows.flat:
        if not 0 <= row < len(distances):
            return False
    for episode in range(episodes):
        for place in range(places):
            apart = np.float64(distances[rows[episode, place]]) / width
            expected = restart * start[episode, place] + (1 - restart) * ahead[episode, place]
            probability[episode, place] = (math.exp(-apart * apart / 2) + mismatch) * expected
    _normalise(probability)
    return True


@njit(cache=True)
def compete(probability, passes, distances, spans, reach, confidences):  # noqa: C901 - likewise
    """Writes the confidences `[K]` of schemas.

    Args:
        probability: of every place of every known episode, flat.
        passes: the first and the last place of each, and the schema that it passes, `[N, 3]`.
        distances: of the percept from every row, `[R]`.
        spans: the first row of each schema and the one behind its last, `[K, 2]`.
        reach: distance from its nearest row beyond which a schema does not compete.
        confidences: where to write.

    Returns:
        Whether all of these lie within one another.
    """
    for number in range(len(passes)):
        first, last, schema = passes[number, 0], passes[number, 1], passes[number, 2]
        if not (first >= 0 and last < len(probability) and 0 <= schema < len(spans)):
            return False
    for schema in range(len(spans)):
        if not 0 <= spans[schema, 0] <= spans[schema, 1] <= len(distances):
            return False
    watched = np.zeros(len(spans), np.float64)
    for number in range(len(passes)):
        schema = passes[number, 2]
        for place in range(passes[number, 0], passes[number, 1] + 1):
            watched[schema] += probability[place]
    for schema in range(len(spans)):
        nearest = np.float32(np.inf)
        for row in range(spans[schema, 0], spans[schema, 1]):
            nearest = min(nearest, distances[row])
        confidences[schema] = min(watched[schema], 1.0) * math.exp(-nearest)
        if nearest > reach:
            confidences[schema] = OUT_OF_REACH
    return True


@njit
def _normalise(probability):
    total = probability.sum()
    for episode in range(len(probability)):
        for place in range(probability.shape[1]):
            probability[episode, place] /= total
