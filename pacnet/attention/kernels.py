"""The growing map's rule as machine code: learns a whole sequence in one call.

`pacnet.attention.eager` is the specification; these kernels follow it line by line on arrays that
share the map's memory, and round as it does, so that exact data give the same bytes.

N nodes and E edges are in use, of a capacity of C and F. Beside the edges, each node has a list of
the edges that end at it: a search among all edges would take longer than everything else.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pacnet.kernels.distances import squared_distances
from pacnet.kernels.engine import announce_compilation

announce_compilation()

# What happened to a sample, as bits of one byte.
NOVEL, INSERTED, IGNORED, DISHABITUATED, HABITUATED = 1, 2, 4, 8, 16

# Why `learn` returned.
DONE, FULL, ISOLATED, INVALID = 0, 1, 2, 3

NO_NODE = -1  # as in `pacnet.attention.records`; a literal here, so that it is compiled in
NODES, EDGES, LISTED = 0, 1, 2  # indices in `counts`
NOT_LISTED = -1  # value of the last one


class MapArrays(NamedTuple):
    """The map's memory, and the lists of edges."""

    prototype: NDArray[np.float32]  # [D, C]
    habituation: NDArray[np.float32]  # [C]
    habituated_at: NDArray[np.int64]  # [C]
    ends: NDArray[np.int64]  # [F, 2]
    age: NDArray[np.int64]  # [F]
    time: NDArray[np.int64]  # [1], samples learned
    lists: NDArray[np.int64]  # [C, M], indices of each node's edges
    degree: NDArray[np.int64]  # [C], number of each node's edges
    listed_ends: NDArray[np.int64]  # [F, 2], ends of the edges in the lists
    counts: NDArray[np.int64]  # [3]: N, E, and N when the lists held all edges


@njit(cache=True)
def read_one(percept, scale, largest, prototype, nodes, novel_from, scaled):
    """Write one percept `[D]` normalized to `scaled`, `[1, D]`, and read it.

    Returns:
        Whether it is finite and not too large; winner, runner-up, activation and novelty.
    """
    fits = len(percept) == len(prototype) and nodes <= prototype.shape[1]
    if not fits or not scale_one(percept, scale, largest, scaled):
        return False, NO_NODE, NO_NODE, np.float32(0), False
    distances, first = np.empty(nodes + 1, np.float32), np.int64(0)
    best, second = squared_distances(scaled, first, prototype, first, nodes, distances)
    distance = np.sqrt(distances[max(best, 0)])
    novel = best == NO_NODE or distance >= novel_from
    return True, best, second, _activation(best, distance), novel


@njit(cache=True)
def scale_one(percept, scale, largest, scaled):
    """Write percept × scale to `[1, D]`; return whether it is finite and within ±`largest`."""
    valid = len(percept) == len(scale) == scaled.shape[1]
    for d in range(len(scale) if valid else 0):
        scaled[0, d] = percept[d] * scale[d]
        valid &= abs(scaled[0, d]) <= largest  # false for NaN as well
    return valid


@njit(cache=True, nogil=True)
def read(percepts, prototype, nodes, novel_from, winner, runner_up, activation, novelty):
    """Read normalized percepts `[B, D]` into four arrays `[B]`; prototypes are `[D, N]`."""
    distances, first = np.empty(nodes + 1, np.float32), np.int64(0)
    for sample in range(len(percepts)):
        best, second = squared_distances(percepts, sample, prototype, first, nodes, distances)
        distance = np.sqrt(distances[max(best, 0)])
        winner[sample], runner_up[sample] = best, second
        activation[sample] = _activation(best, distance)
        novelty[sample] = best == NO_NODE or distance >= novel_from


# One long function: to pass arrays to others at each sample would take longer than to learn it,
# as numba counts their references.
@njit(cache=True, nogil=True)
def learn(  # noqa: C901
    percepts, start, prototype, habituation, habituated_at, ends, age, time, lists, degree,
    listed_ends, counts, rules, winner, runner_up, activation, events, isolated,
):  # fmt: skip
    """Learn normalized percepts `[T, D]` from sample `start` on.

    Changed in place are the fields of `MapArrays`, from `prototype` on. Written are the fields of
    `kernel_records.Record`, from `winner` on, and `isolated`, `[C + 1]`: nodes to delete, and last
    their number. `rules` is one row of `kernel_records.RULES`.

    Returns:
        The index of the next sample; N and E; and why it returned: DONE; FULL, of nodes, edges or a
        list; ISOLATED, where the caller deletes the nodes that the last sample has left without an
        edge; INVALID, of arrays that do not fit together, or edges between nodes that do not exist.
    """
    arrays = MapArrays(
        prototype, habituation, habituated_at, ends, age, time, lists, degree, listed_ends, counts
    )
    rule = rules[0]
    status = _list_edges(arrays) if _fits_together(percepts, arrays) else INVALID
    if status != DONE:
        return start, status, counts[NODES], counts[EDGES]
    stale = True  # whether an edge may be too old, as one that was loaded
    capacity, first = prototype.shape[1], np.int64(0)
    distances = np.empty(capacity + 1, np.float32)
    for sample in range(start, len(percepts)):
        nodes = counts[NODES]
        best, second = squared_distances(percepts, sample, prototype, first, nodes, distances)
        distance = np.sqrt(distances[max(best, 0)])
        if (
            nodes == capacity
            or counts[EDGES] + 2 > len(age)
            or (best != NO_NODE and max(degree[best], degree[max(second, 0)]) == lists.shape[1])
        ):
            _note_listed(arrays)
            return sample, FULL, counts[NODES], counts[EDGES]
        time[0] += 1
        winner[sample], runner_up[sample] = best, second
        activation[sample] = _activation(best, distance)
        if best == NO_NODE:
            _add_node(percepts, sample, arrays, rule)
            events[sample] = NOVEL | INSERTED
            continue
        event = NOVEL if distance >= rule.novel_from else 0

        # Forgetting: an interval after it habituated, the winner responds again.
        forgets = rule.forgetting_interval != NO_NODE
        since = habituated_at[best]
        if forgets and since != NO_NODE and time[0] - since >= rule.forgetting_interval:
            habituation[best], habituated_at[best] = rule.resting_habituation, NO_NODE
            event |= DISHABITUATED
        habituated = habituation[best] < rule.habituated_below

        # Case 1: the match is not good enough. Novelty: a new node.
        if event & NOVEL and (habituated or not rule.insert_only_when_habituated):
            _insert(percepts, sample, best, second, arrays, rule)
            events[sample] = event | INSERTED
            continue
        if habituated:
            event |= HABITUATED

        # Case 3: the winner is fully habituated. It ignores the percept.
        if habituated and rule.ignore_when_habituated:
            events[sample] = event | IGNORED
            continue

        # Case 2: a good match. Winner and neighbours move towards the percept and habituate.
        events[sample] = event
        joined = second == NO_NODE
        for index in range(degree[best]):
            edge = lists[best, index]
            if ends[edge, 0] + ends[edge, 1] - best == second:
                age[edge], joined = 0, True
        if not joined:
            _join(best, second, arrays)
        rate, decay = rule.winner_rate, rule.winner_decay
        node = best
        for index in range(-1, degree[best]):
            if index >= 0:
                edge = lists[best, index]
                node = ends[edge, 0] + ends[edge, 1] - best
                rate, decay = rule.neighbour_rate, rule.neighbour_decay
                age[edge] += 1
                stale |= age[edge] > rule.max_edge_age
                since = habituated_at[node]
                if forgets and since != NO_NODE and time[0] - since >= rule.forgetting_interval:
                    habituation[node], habituated_at[node] = rule.resting_habituation, NO_NODE
                if rule.ignore_when_habituated and habituation[node] < rule.habituated_below:
                    continue
            # One firing of Stanley's equation, in closed form.
            fraction = rate * habituation[node] if rule.habituation_scales_learning else rate
            for d in range(len(prototype)):
                prototype[d, node] += fraction * (percepts[sample, d] - prototype[d, node])
            floor = rule.floor_habituation
            habituation[node] = floor + (habituation[node] - floor) * decay
            if habituation[node] < rule.habituated_below and habituated_at[node] == NO_NODE:
                habituated_at[node] = time[0]
        if stale:
            stale = False
            if _drop_old_edges(arrays, rule, isolated) > 0:
                return sample + 1, ISOLATED, counts[NODES], counts[EDGES]
    _note_listed(arrays)
    return len(percepts), DONE, counts[NODES], counts[EDGES]


@njit
def _fits_together(percepts, arrays):
    """Return whether every index lies within its array, even for a damaged map."""
    capacity, counts = arrays.prototype.shape[1], arrays.counts
    fits = percepts.shape[1] == len(arrays.prototype) and arrays.ends.shape[1] == 2
    fits &= len(arrays.habituation) >= capacity and len(arrays.habituated_at) >= capacity
    fits &= len(arrays.degree) >= capacity and len(arrays.lists) >= capacity
    fits &= len(arrays.ends) >= len(arrays.age) >= counts[EDGES]
    fits &= len(arrays.listed_ends) >= len(arrays.age)
    return fits and counts[NODES] <= capacity


@njit
def _activation(winner, distance):
    return np.float32(0) if winner == NO_NODE else np.float32(np.exp(-np.float64(distance)))


@njit
def _insert(percepts, sample, winner, runner_up, arrays, rule):
    node = _add_node(percepts, sample, arrays, rule)
    _join(winner, node, arrays)
    if rule.insert_at_percept:
        return
    for d in range(percepts.shape[1]):
        middle = (arrays.prototype[d, winner] + percepts[sample, d]) / np.float32(2)
        arrays.prototype[d, node] = middle
    if runner_up != NO_NODE:
        _join(runner_up, node, arrays)
        edge = _edge_between(winner, runner_up, arrays)
        if edge != NO_NODE:
            _drop_edge(edge, arrays)


@njit
def _add_node(percepts, sample, arrays, rule):
    """Add a node at the percept; return its index."""
    node = arrays.counts[NODES]
    for d in range(percepts.shape[1]):
        arrays.prototype[d, node] = percepts[sample, d]
    arrays.habituation[node], arrays.habituated_at[node] = rule.resting_habituation, NO_NODE
    arrays.degree[node] = 0
    arrays.counts[NODES] = node + 1
    return node


@njit
def _join(one, other, arrays):
    """Make an edge between two nodes, or set its age to 0."""
    if other == NO_NODE:
        return
    edge = _edge_between(one, other, arrays)
    if edge == NO_NODE:
        edge = arrays.counts[EDGES]
        arrays.counts[EDGES] = edge + 1
        arrays.ends[edge, 0], arrays.ends[edge, 1] = min(one, other), max(one, other)
        _list(edge, one, arrays)
        _list(edge, other, arrays)
    arrays.age[edge] = 0


@njit
def _edge_between(one, other, arrays):
    for index in range(arrays.degree[one]):
        edge = arrays.lists[one, index]
        if arrays.ends[edge, 0] + arrays.ends[edge, 1] - one == other:
            return edge
    return NO_NODE


@njit
def _list(edge, node, arrays):
    arrays.lists[node, arrays.degree[node]] = edge
    arrays.degree[node] += 1


@njit
def _index_of(edge, node, arrays):
    """Return the index of an edge in a node's list."""
    for index in range(arrays.degree[node]):
        if arrays.lists[node, index] == edge:
            return index
    return 0  # does not happen: the edge is listed at both of its ends


@njit
def _drop_edge(edge, arrays):
    """Delete an edge; the last one takes its index."""
    last = arrays.counts[EDGES] - 1
    for end in range(2):
        node = arrays.ends[edge, end]
        last_listed = arrays.degree[node] - 1
        arrays.lists[node, _index_of(edge, node, arrays)] = arrays.lists[node, last_listed]
        arrays.degree[node] = last_listed
    if edge != last:
        for end in range(2):
            node = arrays.ends[last, end]
            arrays.lists[node, _index_of(last, node, arrays)] = edge
            arrays.ends[edge, end] = node
        arrays.age[edge] = arrays.age[last]
    arrays.counts[EDGES] = last


@njit
def _drop_old_edges(arrays, rule, isolated):
    """Delete old edges; write the nodes left without an edge to `isolated`, return their number."""
    count = 0
    for edge in range(arrays.counts[EDGES] - 1, -1, -1):
        if arrays.age[edge] > rule.max_edge_age:
            one, other = arrays.ends[edge, 0], arrays.ends[edge, 1]
            _drop_edge(edge, arrays)
            for node in (one, other):
                if arrays.degree[node] == 0:
                    isolated[count] = node
                    count += 1
    isolated[-1] = count
    return count


@njit
def _list_edges(arrays):
    """List the edges of each node, unless the lists are current."""
    listed = _are_listed(arrays)
    arrays.counts[LISTED] = NOT_LISTED  # until `learn` has finished
    if listed:
        return DONE
    nodes, longest = arrays.counts[NODES], arrays.lists.shape[1]
    arrays.degree[:] = 0
    for edge in range(arrays.counts[EDGES]):
        one, other = arrays.ends[edge, 0], arrays.ends[edge, 1]
        if not (0 <= one < nodes and 0 <= other < nodes and one != other):
            return INVALID
        if max(arrays.degree[one], arrays.degree[other]) == longest:
            return FULL
        _list(edge, one, arrays)
        _list(edge, other, arrays)
    return DONE


@njit
def _note_listed(arrays):
    """Note that the lists hold the current edges."""
    for edge in range(arrays.counts[EDGES]):
        for end in range(2):
            arrays.listed_ends[edge, end] = arrays.ends[edge, end]
    arrays.counts[LISTED] = arrays.counts[NODES]


@njit
def _are_listed(arrays):
    """Return whether the lists hold exactly these edges, of as many nodes."""
    changed = arrays.counts[LISTED] != arrays.counts[NODES]
    for edge in range(arrays.counts[EDGES]):
        for end in range(2):
            changed |= arrays.listed_ends[edge, end] != arrays.ends[edge, end]
    return not changed
