"""The growing map's pass over a sequence as machine code: what `HabituatingSOFM` does, in one call.

The eager methods of `HabituatingSOFM` are the specification; these kernels follow them line by line
on the same buffers, and round as they do, so that exact data give the same bytes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pacnet.batch_kernels import MOST_ROWS, TOGETHER, two_nearest_of_each
from pacnet.distances import ROOM, ROWS, in_whole_vectors, squared_distance, squared_distances
from pacnet.engine import announce_compilation
from pacnet.lanes import any_equal, any_up_to, store
from pacnet.pointers import floats, integers

announce_compilation()

# What happened to a sample, as bits of one byte.
NOVEL, INSERTED, IGNORED, DISHABITUATED, HABITUATED = 1, 2, 4, 8, 16

DONE, INVALID, NO_ROOM = 0, 1, 2  # how a step ended
NOBODY = -1  # as in `pacnet.attention`; a literal here, so that it is compiled in
_BLOCK, _ENDS = 8, 16  # edges, and their ends, compared at once while looking for a node's


class Buffers(NamedTuple):
    """The map's buffers, borrowed: capacities C of nodes and E of edges, D dimensions.

    Pointers, which numba neither counts nor checks as it does arrays.
    """

    prototype: Any  # float32 [C * D]
    habituation: Any  # float32 [C]
    habituated_at: Any  # int64 [C]
    ends: Any  # int64 [E * 2]
    age: Any  # int64 [E]
    time: Any  # int64 [1]
    scale: Any  # float32 [D]
    node_count: Any  # int64 [1]
    edge_count: Any  # int64 [1]
    percept: Any  # float32 [D in whole vectors], the scaled one that is learned or read
    distances: Any  # float32 [ROWS], of a block of nodes
    last_block: Any  # float32 [ROWS * D, and a vector]
    nodes: int  # C
    edges: int  # E
    dimensions: int  # D


class Log(NamedTuple):
    """What the kernels write down of T samples."""

    winner: NDArray[np.int64]  # [T]
    runner_up: NDArray[np.int64]  # [T]
    activation: NDArray[np.float32]  # [T]
    events: NDArray[np.uint8]  # [T], bits
    deleted: NDArray[np.int64]  # [T], number of nodes that went
    gone: NDArray[np.int64]  # [sum of deleted, and room], their numbers, before each sample's went


def scratch(dimensions: int) -> NDArray[np.float32]:
    """Room for a scaled percept, for the distances of a block of nodes, and for such a block."""
    whole = in_whole_vectors.py_func(dimensions)
    return np.zeros(whole + ROWS + ROWS * dimensions + ROOM, np.float32)


@njit
def _buffers_at(table, scratch):
    """What lies where `pacnet.compiled_sofm` says, and a scratch at this address."""
    dimensions = table[11]
    distances = scratch + 4 * in_whole_vectors(dimensions)
    return Buffers(
        prototype=floats(table[0]),
        habituation=floats(table[1]),
        habituated_at=integers(table[2]),
        ends=integers(table[3]),
        age=integers(table[4]),
        time=integers(table[5]),
        scale=floats(table[6]),
        node_count=integers(table[7]),
        edge_count=integers(table[8]),
        percept=floats(scratch),
        distances=floats(distances),
        last_block=floats(distances + 4 * ROWS),
        nodes=table[9],
        edges=table[10],
        dimensions=dimensions,
    )


@njit(cache=True, nogil=True)
def observe(percepts, table, scratch, rules, log, start, stop, gone):
    """Learns scaled percepts `[T, D]` from sample `start` on, until `stop` or there is no room.

    Returns:
        The number of the first sample that was not learned: `stop`, or where the caller makes room
        for one more node and two more edges, and goes on; and `gone`, the number of nodes that went
        since the log began.
    """
    buffers, rule = _buffers_at(table, scratch), rules[0]
    numbers_gone = log.gone.ctypes.data
    stale = _any_older(buffers, rule.max_edge_age)
    winner, runner_up = NOBODY, NOBODY
    for sample in range(start, stop):
        if not _has_room(buffers):
            return sample, gone
        for d in range(buffers.dimensions):
            buffers.percept[d] = percepts[sample, d]
        winner, runner_up, squared = _two_nearest(buffers, winner, runner_up)
        distance = np.sqrt(squared)
        room = integers(numbers_gone + 8 * gone)
        events, deleted = _learn(buffers, rule, winner, runner_up, distance, stale, room)
        if not events & (INSERTED | IGNORED):
            stale = False
        log.winner[sample], log.runner_up[sample] = winner, runner_up
        log.activation[sample] = _activation(winner, distance)
        log.events[sample], log.deleted[sample] = events, deleted
        gone += deleted
        if events & INSERTED:
            winner, runner_up = buffers.node_count[0] - 1, winner  # what is near now
    return stop, gone


@njit(cache=True, nogil=True)
def step(table, scratch, rules, largest, learns):
    """Scales the one percept that lies in the scratch, and learns it, or only reads.

    Returns:
        DONE; or INVALID, of a percept that is not finite or beyond ±`largest` when scaled, or
        NO_ROOM for one more node and two more edges: then nothing has changed, and the percept is
        as it was. And the fields of a `Step`.
    """
    buffers, rule = _buffers_at(table, scratch), rules[0]
    winner, runner_up, distance, events, deleted = NOBODY, NOBODY, np.float32(0), 0, 0
    valid = True
    for d in range(buffers.dimensions):
        valid &= abs(buffers.percept[d] * buffers.scale[d]) <= largest  # false for NaN as well
    status = DONE if valid else INVALID
    if valid and learns and not _has_room(buffers):
        status = NO_ROOM
    if status == DONE:
        for d in range(buffers.dimensions):
            buffers.percept[d] *= buffers.scale[d]
        winner, runner_up, squared = _two_nearest(buffers, NOBODY, NOBODY)
        distance = np.sqrt(squared)
        events = IGNORED | (NOVEL if _is_novel(winner, distance, rule) else 0)
        if learns:
            gone = np.empty(buffers.node_count[0] + 1, np.int64)
            room = integers(gone.ctypes.data)
            stale = _any_older(buffers, rule.max_edge_age)
            events, deleted = _learn(buffers, rule, winner, runner_up, distance, stale, room)
            gone[0] = deleted  # in use until here
    ignored = (events & IGNORED) != 0
    fields = (
        winner, runner_up, _activation(winner, distance), (events & NOVEL) != 0, not ignored,
        (events & INSERTED) != 0, ignored, (events & DISHABITUATED) != 0, deleted,
    )  # fmt: skip
    return status, fields


@njit(cache=True, nogil=True)
def read(percepts, table, scratch, rules, winner, runner_up, activation, novelty):
    """Reads scaled percepts `[B, D]` into four arrays `[B]`; each thread has its own scratch."""
    buffers, rule = _buffers_at(table, scratch), rules[0]
    together, best, second = 0, NOBODY, NOBODY
    if buffers.node_count[0] <= MOST_ROWS:
        together = len(percepts) // TOGETHER * TOGETHER
        _read_together(buffers, rule, percepts[:together], winner, runner_up, activation, novelty)
    for sample in range(together, len(percepts)):
        for d in range(buffers.dimensions):
            buffers.percept[d] = percepts[sample, d]
        best, second, squared = _two_nearest(buffers, best, second)
        distance = np.sqrt(squared)
        winner[sample], runner_up[sample] = best, second
        activation[sample] = _activation(best, distance)
        novelty[sample] = _is_novel(best, distance, rule)


@njit
def _read_together(buffers, rule, percepts, winner, runner_up, activation, novelty):
    """The same, to the same bits, for percepts that are a multiple of `TOGETHER`."""
    dimensions, nodes = buffers.dimensions, buffers.node_count[0]
    laid = np.zeros((in_whole_vectors(dimensions), TOGETHER), np.float32)
    found = np.empty((3, TOGETHER), np.float32)
    pointers = floats(laid.ctypes.data), floats(found.ctypes.data)
    for first in range(0, len(percepts), TOGETHER):
        for d in range(dimensions):
            for lane in range(TOGETHER):
                laid[d, lane] = percepts[first + lane, d]
        two_nearest_of_each(
            pointers[0], buffers.prototype, nodes, dimensions, buffers.percept, pointers[1]
        )
        for lane in range(TOGETHER):
            sample, distance = first + lane, np.sqrt(found[2, lane])
            best = np.int64(found[0, lane])
            winner[sample], runner_up[sample] = best, np.int64(found[1, lane])
            activation[sample] = _activation(best, distance)
            novelty[sample] = _is_novel(best, distance, rule)


@njit
def _two_nearest(buffers, one, other):
    """Nearest and second nearest, of equal ones the lowest numbers, and the squared distance.

    Args:
        buffers: with the percept.
        one: a node that may be near, as the last winner may, or NOBODY.
        other: another one. Only what is as near as these two must be looked at closely.
    """
    nearest, second = np.float32(np.inf), np.float32(np.inf)
    winner, runner_up = NOBODY, NOBODY
    nodes, dimensions = buffers.node_count[0], buffers.dimensions
    limit = second
    # A block may read beyond the nodes, and a vector beyond its last row, but not the buffer.
    within = (buffers.nodes * dimensions - ROOM) // dimensions // ROWS * ROWS
    if NOBODY < one < min(nodes, within) and NOBODY < other < min(nodes, within) and one != other:
        limit = max(
            squared_distance(buffers.percept, buffers.prototype, one * dimensions, dimensions),
            squared_distance(buffers.percept, buffers.prototype, other * dimensions, dimensions),
        )
        limit *= np.float32(1 + 1e-5)  # both are summed in another order than the blocks
    for node in range(0, nodes, ROWS):
        rows, at = buffers.prototype, node * dimensions
        if node >= within:
            for place in range(min(ROWS, nodes - node) * dimensions):
                buffers.last_block[place] = buffers.prototype[at + place]
            rows, at = buffers.last_block, 0
        block = squared_distances(buffers.percept, rows, at, dimensions, limit)
        if not any_up_to(block, limit):
            continue
        store(buffers.distances, 0, block)
        for place in range(min(ROWS, nodes - node)):  # no branch in it, for none can be foreseen
            distance, number = buffers.distances[place], node + place
            is_nearest, is_second = distance < nearest, distance < second
            runner_up = winner if is_nearest else (number if is_second else runner_up)
            second = nearest if is_nearest else (distance if is_second else second)
            winner = number if is_nearest else winner
            nearest = distance if is_nearest else nearest
        limit = min(limit, second)
    return winner, runner_up, nearest


@njit
def _activation(winner, distance):
    if winner == NOBODY:
        return np.float32(0)
    return np.float32(np.exp(-np.float64(distance)))


@njit
def _is_novel(winner, distance, rule):
    return winner == NOBODY or distance >= rule.novel_from


@njit
def _has_room(buffers):
    return buffers.node_count[0] < buffers.nodes and buffers.edge_count[0] + 2 <= buffers.edges


@njit
def _learn(buffers, rule, winner, runner_up, distance, stale, gone):
    """`HabituatingSOFM._learn`: the three cases of the paper.

    Returns:
        The events, and the number of nodes that went, whose numbers are written to `gone`.
    """
    buffers.time[0] += 1
    if winner == NOBODY:
        _add_node(buffers, rule)
        return NOVEL | INSERTED, 0
    events = NOVEL if _is_novel(winner, distance, rule) else 0

    # Forgetting: an interval after it habituated, the winner responds again.
    if _forget(buffers, rule, winner):
        events |= DISHABITUATED

    # Case 1: the match is not good enough. Novelty: a new node.
    habituated = buffers.habituation[winner] < rule.habituated_below
    if events & NOVEL and (habituated or not rule.insert_only_when_habituated):
        _insert(buffers, rule, winner, runner_up)
        return events | INSERTED, 0
    if habituated:
        events |= HABITUATED

    # Case 3: the winner is fully habituated. It ignores the percept.
    if habituated and rule.ignore_when_habituated:
        return events | IGNORED, 0

    # Case 2: a good match. Winner and neighbours move towards the percept and habituate.
    _move_and_habituate(buffers, rule, winner, rule.winner_rate, rule.winner_decay)
    if _respond_around(buffers, rule, winner, runner_up) or stale:
        return events, _drop_old_edges(buffers, rule, winner, stale, gone)
    return events, 0


@njit
def _respond_around(buffers, rule, winner, runner_up):
    """Joins winner and runner-up, moves the winner's neighbours, and ages its edges.

    One walk over the winner's edges does it; neighbours do not depend on one another.

    Returns:
        Whether one of the edges is too old now.
    """
    ends, age = buffers.ends, buffers.age
    old, joined = False, runner_up == NOBODY
    edge = _next_edge_of(winner, buffers, 0)
    while edge < buffers.edge_count[0]:
        neighbour = ends[2 * edge] + ends[2 * edge + 1] - winner
        if neighbour == runner_up:
            age[edge] = 0
            joined = True
        _move_neighbour(buffers, rule, neighbour)
        age[edge] += 1
        old |= age[edge] > rule.max_edge_age
        edge = _next_edge_of(winner, buffers, edge + 1)
    if not joined:
        _move_neighbour(buffers, rule, runner_up)
        _add_edge(buffers, winner, runner_up, 1)  # made at this sample, and aged with the others
    return old


@njit
def _move_neighbour(buffers, rule, node):
    _forget(buffers, rule, node)
    if not (rule.ignore_when_habituated and buffers.habituation[node] < rule.habituated_below):
        _move_and_habituate(buffers, rule, node, rule.neighbour_rate, rule.neighbour_decay)


@njit
def _forget(buffers, rule, node):
    since = buffers.habituated_at[node]
    if rule.forgetting_interval == NOBODY or since == NOBODY:
        return False
    if buffers.time[0] - since < rule.forgetting_interval:
        return False
    buffers.habituation[node] = rule.resting_habituation
    buffers.habituated_at[node] = NOBODY
    return True


@njit
def _move_and_habituate(buffers, rule, node, rate, decay):
    habituation, at = buffers.habituation[node], node * buffers.dimensions
    fraction = rate * habituation if rule.habituation_scales_learning else rate
    for d in range(buffers.dimensions):
        place = buffers.prototype[at + d]
        buffers.prototype[at + d] = place + fraction * (buffers.percept[d] - place)
    floor = rule.floor_habituation
    habituation = floor + (habituation - floor) * decay
    buffers.habituation[node] = habituation
    if habituation < rule.habituated_below and buffers.habituated_at[node] == NOBODY:
        buffers.habituated_at[node] = buffers.time[0]


@njit
def _insert(buffers, rule, winner, runner_up):
    node = _add_node(buffers, rule)
    _add_edge(buffers, winner, node, 0)
    if rule.insert_at_percept:
        return
    at, beside = node * buffers.dimensions, winner * buffers.dimensions
    for d in range(buffers.dimensions):
        middle = (buffers.prototype[beside + d] + buffers.percept[d]) / np.float32(2)
        buffers.prototype[at + d] = middle
    if runner_up != NOBODY:
        _add_edge(buffers, runner_up, node, 0)
        _drop_edge_between(buffers, winner, runner_up)


@njit
def _add_node(buffers, rule):
    """At the percept; returns its number."""
    node = buffers.node_count[0]
    for d in range(buffers.dimensions):
        buffers.prototype[node * buffers.dimensions + d] = buffers.percept[d]
    buffers.habituation[node] = rule.resting_habituation
    buffers.habituated_at[node] = NOBODY
    buffers.node_count[0] = node + 1
    return node


@njit
def _add_edge(buffers, one, other, age):
    edge = buffers.edge_count[0]
    buffers.ends[2 * edge] = min(one, other)
    buffers.ends[2 * edge + 1] = max(one, other)
    buffers.age[edge] = age
    buffers.edge_count[0] = edge + 1


@njit
def _next_edge_of(node, buffers, start):
    """Number of the first edge from `start` on that ends at this node, or that of edges."""
    ends, edges = buffers.ends, buffers.edge_count[0]
    for first in range(start, edges, _BLOCK):
        after = min(first + _BLOCK, edges)
        if after - first < _BLOCK or any_equal(ends, 2 * first, _ENDS, node):
            for edge in range(first, after):
                if ends[2 * edge] == node or ends[2 * edge + 1] == node:
                    return edge
    return edges


@njit
def _any_older(buffers, max_age):
    """Whether an edge is too old: none is after learning, but one may be that was loaded."""
    older = False
    for edge in range(buffers.edge_count[0]):
        older |= buffers.age[edge] > max_age
    return older


@njit
def _drop_edge_between(buffers, one, other):
    ends = buffers.ends
    edge = _next_edge_of(one, buffers, 0)
    while edge < buffers.edge_count[0]:
        if ends[2 * edge] + ends[2 * edge + 1] - one == other:
            _swap_out_edge(buffers, edge)
            return
        edge = _next_edge_of(one, buffers, edge + 1)


@njit
def _swap_out_edge(buffers, edge):
    """The last one takes its place."""
    last = buffers.edge_count[0] - 1
    buffers.ends[2 * edge] = buffers.ends[2 * last]
    buffers.ends[2 * edge + 1] = buffers.ends[2 * last + 1]
    buffers.age[edge] = buffers.age[last]
    buffers.edge_count[0] = last


@njit
def _drop_old_edges(buffers, rule, winner, stale, gone):
    """Drops the old edges, then the nodes left without an edge.

    Returns:
        How many nodes went; `gone` begins with the numbers that they had, in ascending order.
    """
    candidates = 0
    edge = _last_old_edge(buffers, rule, winner, stale)
    while edge != NOBODY:
        candidates = _note(gone, candidates, buffers.ends[2 * edge])
        candidates = _note(gone, candidates, buffers.ends[2 * edge + 1])
        _swap_out_edge(buffers, edge)
        edge = _last_old_edge(buffers, rule, winner, stale)
    lonely = 0
    for place in range(candidates):
        if _next_edge_of(gone[place], buffers, 0) == buffers.edge_count[0]:
            gone[lonely] = gone[place]
            lonely += 1
    for place in range(lonely - 1, -1, -1):  # the last first: the others keep their numbers
        _drop_node(buffers, gone[place])
    return lonely


@njit
def _last_old_edge(buffers, rule, winner, stale):
    """Number of the last edge that is too old, or NOBODY; only a stale one is not the winner's."""
    found, edge = NOBODY, 0 if stale else _next_edge_of(winner, buffers, 0)
    while edge < buffers.edge_count[0]:
        if buffers.age[edge] > rule.max_edge_age:
            found = edge
        edge = edge + 1 if stale else _next_edge_of(winner, buffers, edge + 1)
    return found


@njit
def _note(numbers, count, number):
    """Puts a number in its place among the first `count` ascending ones, unless it is there."""
    place = count
    while place > 0 and numbers[place - 1] >= number:
        place -= 1
    if place < count and numbers[place] == number:
        return count
    for later in range(count, place, -1):
        numbers[later] = numbers[later - 1]
    numbers[place] = number
    return count + 1


@njit
def _drop_node(buffers, node):
    """Deletes a node; later ones move down, and the edges' numbers with them."""
    last, dimensions = buffers.node_count[0] - 1, buffers.dimensions
    for place in range(node * dimensions, last * dimensions):
        buffers.prototype[place] = buffers.prototype[place + dimensions]
    for later in range(node, last):
        buffers.habituation[later] = buffers.habituation[later + 1]
        buffers.habituated_at[later] = buffers.habituated_at[later + 1]
    buffers.node_count[0] = last
    for end in range(2 * buffers.edge_count[0]):
        buffers.ends[end] -= buffers.ends[end] > node
