"""The growing map's rule as machine code: learns a whole sequence in one call.

`pacnet.attention.eager` is the specification; these kernels follow it line by line on arrays that
share the map's memory, and round as it does, so that exact data give the same bytes.

N nodes and E edges are in use, of a capacity of C and F; see `edge_kernels`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pacnet.attention import edge_kernels as edges
from pacnet.attention.edge_kernels import EDGES, NO_NODE, NODES, MapArrays
from pacnet.kernels.caching import cached_njit
from pacnet.kernels.distances import squared_distances

# What happened to a sample, as bits of one byte.
NOVEL, INSERTED, IGNORED, DISHABITUATED, HABITUATED = 1, 2, 4, 8, 16


@cached_njit()
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


@cached_njit()
def scale_one(percept, scale, largest, scaled):
    """Write percept × scale to `[1, D]`; return whether it is finite and within ±`largest`."""
    valid = len(percept) == len(scale) == scaled.shape[1]
    for d in range(len(scale) if valid else 0):
        scaled[0, d] = percept[d] * scale[d]
        valid &= abs(scaled[0, d]) <= largest  # false for NaN as well
    return valid


@cached_njit(nogil=True)
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
@cached_njit(nogil=True)
def learn(  # noqa: C901
    percepts, start, prototype, habituation, habituated_at, ends, age, time, lists, degree,
    listed_ends, counts, rules, winner, runner_up, activation, events, since, isolated,
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
    status = edges.list_edges(arrays) if _fits_together(percepts, arrays) else edges.INVALID
    if status != edges.DONE:
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
            edges.note_listed(arrays)
            return sample, edges.FULL, counts[NODES], counts[EDGES]
        time[0] += 1
        winner[sample], runner_up[sample] = best, second
        activation[sample] = _activation(best, distance)
        if best == NO_NODE:
            _add_node(percepts, sample, arrays, rule)
            events[sample], since[sample] = NOVEL | INSERTED, NO_NODE
            continue
        event = NOVEL if distance >= rule.novel_from else 0

        # Forgetting: an interval after it habituated, the winner responds again.
        forgets = rule.forgetting_interval != NO_NODE
        begun = habituated_at[best]
        if forgets and begun != NO_NODE and time[0] - begun >= rule.forgetting_interval:
            habituation[best], habituated_at[best] = rule.resting_habituation, NO_NODE
            event |= DISHABITUATED
        habituated = habituation[best] < rule.habituated_below
        since[sample] = habituated_at[best]

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
            edges.join(best, second, arrays)
        rate, decay = rule.winner_rate, rule.winner_decay
        node = best
        for index in range(-1, degree[best]):
            if index >= 0:
                edge = lists[best, index]
                node = ends[edge, 0] + ends[edge, 1] - best
                rate, decay = rule.neighbour_rate, rule.neighbour_decay
                age[edge] += 1
                stale |= age[edge] > rule.max_edge_age
                begun = habituated_at[node]
                if forgets and begun != NO_NODE and time[0] - begun >= rule.forgetting_interval:
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
            if edges.drop_old_edges(arrays, rule, isolated) > 0:
                return sample + 1, edges.ISOLATED, counts[NODES], counts[EDGES]
    edges.note_listed(arrays)
    return len(percepts), edges.DONE, counts[NODES], counts[EDGES]


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
    edges.join(winner, node, arrays)
    if rule.insert_at_percept:
        return
    for d in range(percepts.shape[1]):
        middle = (arrays.prototype[d, winner] + percepts[sample, d]) / np.float32(2)
        arrays.prototype[d, node] = middle
    if runner_up != NO_NODE:
        edges.join(runner_up, node, arrays)
        edge = edges.edge_between(winner, runner_up, arrays)
        if edge != NO_NODE:
            edges.drop_edge(edge, arrays)


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
