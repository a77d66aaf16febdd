"""Recall from schemas that compete, as machine code: distances, the belief, and the confidences.

`CompetingSchemas`, `Belief` and `NodeSchemas` in torch are the specification.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pacnet.distances import ROOM, ROWS, in_whole_vectors, squared_distances
from pacnet.engine import announce_compilation
from pacnet.lanes import store
from pacnet.node_schemas import OUT_OF_REACH
from pacnet.pointers import floats

announce_compilation()


@njit(cache=True, nogil=True)
def measure(percept, cues, distances):
    """Writes the distances of a percept `[D]` from cues `[R, D]`, with room for whole blocks."""
    count, dimensions = cues.shape
    room = np.zeros(in_whole_vectors(dimensions), np.float32)
    for d in range(dimensions):
        room[d] = percept[d]
    last_block = np.zeros(ROWS * dimensions + ROOM, np.float32)
    within = (count * dimensions - ROOM) // dimensions - ROWS  # a block reads beyond its own rows
    rows, seen, out = (
        floats(cues.ctypes.data),
        floats(room.ctypes.data),
        floats(distances.ctypes.data),
    )
    for place in range(0, count, ROWS):
        block_of, at = rows, place * dimensions
        if place > within:
            for k in range(min(ROWS, count - place) * dimensions):
                last_block[k] = rows[at + k]
            block_of, at = floats(last_block.ctypes.data), 0
        store(out, place, squared_distances(seen, block_of, at, dimensions, np.float32(np.inf)))
    for place in range(count):
        distances[place] = math.sqrt(distances[place])


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def weigh(ahead, start, restart, rows, distances, width, mismatch, probability):
    """Writes the belief `[E, P]` after a percept, from the one before it and distances `[R]`."""
    episodes, places = rows.shape
    for episode in range(episodes):
        for place in range(places):
            apart = np.float64(distances[rows[episode, place]]) / width
            expected = restart * start[episode, place] + (1 - restart) * ahead[episode, place]
            probability[episode, place] = (math.exp(-apart * apart / 2) + mismatch) * expected
    _normalise(probability)


@njit(cache=True, nogil=True)
def compete(probability, passes, distances, spans, reach, confidences):
    """Writes the confidences `[K]` of schemas.

    Args:
        probability: of every place of every known episode, flat.
        passes: the first and the last place of each, and the schema that it passes, `[N, 3]`.
        distances: of the percept from every row, `[R]`.
        spans: the first row of each schema and the one behind its last, `[K, 2]`.
        reach: distance from its nearest row beyond which a schema does not compete.
        confidences: where to write.
    """
    watched = np.zeros(len(spans), np.float64)
    for number in range(len(passes)):
        first, last, schema = passes[number]
        for place in range(first, last + 1):
            watched[schema] += probability[place]
    for schema in range(len(spans)):
        nearest = np.float32(np.inf)
        for row in range(spans[schema, 0], spans[schema, 1]):
            nearest = min(nearest, distances[row])
        confidences[schema] = min(watched[schema], 1.0) * math.exp(-nearest)
        if nearest > reach:
            confidences[schema] = OUT_OF_REACH


@njit
def _normalise(probability):
    total = probability.sum()
    for episode in range(len(probability)):
        for place in range(probability.shape[1]):
            probability[episode, place] /= total
