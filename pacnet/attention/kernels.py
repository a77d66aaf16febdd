"""The growing map's pass over a sequence as machine code: what `HabituatingSOFM` does, in one call.

The eager methods of `HabituatingSOFM` are the specification; these kernels follow them line by line
on arrays that share the map's memory, and round as they do, so that exact data give the same bytes.

N nodes and E edges are in use, of C and F that there is room for. Beside the edges, every node has
a list of those that end at it: to look for them among all would take longer than anything else.
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

# Why `learn` came back.
DONE, NO_ROOM, LONELY, INVALID = 0, 1, 2, 3

NO_NODE = -1  # as in `pacnet.attention.records`; a literal here, so that it is compiled in
NODES, EDGES, LISTED = 0, 1, 2  # places in `counts`
NOT_LISTED = -1  # in the last one


class Map(NamedTuple):
    """The map's memory, and the lists of edges."""

    prototype: NDArray[np.float32]  # [D, C]
    habituation: NDArray[np.float32]  # [C]
    habituated_at: NDArray[np.int64]  # [C]
    ends: NDArray[np.int64]  # [F, 2]
    age: NDArray[np.int64]  # [F]
    time: NDArray[np.int64]  # [1], samples learned
    lists: NDArray[np.int64]  # [C, M], numbers of the edges of each node
    degree: NDArray[np.int64]  # [C], how many these are
    listed: NDArray[np.int64]  # [F, 2], ends of the edges that the lists are of
    counts: NDArray[np.int64]  # [3]: N, E, and N when the lists were of all edges


@njit(cache=True)
def read_one(percept, scale, largest, prototype, nodes, novel_from, scaled):
    """Scales one percept `[D]` into `scaled`, `[1, D]`, and reads it if it is valid.

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
    """Writes percept × scale `[D]` to `[1, D]`; whether it is finite and within ±`largest`."""
    valid = len(percept) == len(scale) == scaled.shape[1]
    for d in range(len(scale) if valid else 0):
        scaled[0, d] = percept[d] * scale[d]
        valid &= abs(scaled[0, d]) <= largest  # false for NaN as well
    return valid


@njit(cache=True, nogil=True)
def read(percepts, prototype, nodes, novel_from, winner, runner_up, activation, novelty):
    """Reads finite, scaled percepts `[B, D]` into four arrays `[B]`; prototypes are `[D, N]`."""
    distances, first = np.empty(nodes + 1, np.float32), np.int64(0)
    for sample in range(len(percepts)):
        best, second = squared_distances(percepts, sample, prototype, first, nodes, distances)
        distance = np.sqrt(distances[max(best, 0)])
        winner[sample], runner_up[sample] = best, second
        activation[sample] = _activation(best, distance)
        novelty[sample] = best == NO_NODE or distance >= novel_from


# One long function: to hand arrays on to others at each sample would take longer than to learn it,
# for numba counts their references.
@njit(cache=True, nogil=True)
def learn(  # noqa: C901
    percepts, start, prototype, habituation, habituated_at, ends, age, time, lists, degree, listed,
    counts, rules, winner, runner_up, activation, events, lonely,
):  # fmt: skip
    """Learns finite, scaled percepts `[T, D]` from sample `start` on.

    Args:
        percepts: float32.
        start: number of the first sample.
        prototype: this and what follows: the fields of a `Map`.
        habituation: see there, as the others.
        habituated_at: see there.
        ends: see there.
        age: see there.
        time: see there.
        lists: see there.
        degree: see there.
        listed: see there.
        counts: see there.
        rules: one row of `pacnet.attention.kernel_rules.RULES`.
        winner: the record of T samples, `[T]`; and so on.
        runner_up: `[T]`.
        activation: `[T]`.
        events: bits, `[T]`.
        lonely: room for numbers of nodes, `[C + 1]`; the last place is how many.

    Returns:
        The number of the next sample, and why it came back: DONE; NO_ROOM for one more node and two
        more edges, or in a list; LONELY, where the caller deletes the nodes that the last sample
        has left without an edge; INVALID, of arrays that do not fit together, or of edges that lead
        nowhere. And N and E.
    """
    here = Map(
        prototype, habituation, habituated_at, ends, age, time, lists, degree, listed, counts
    )
    rule = rules[0]
    status = _list_edges(here) if _fits_together(percepts, here) else INVALID
    if status != DONE:
        return start, status, counts[NODES], counts[EDGES]
    stale = _any_older(here, rule.max_edge_age)
    room, first = prototype.shape[1], np.int64(0)
    distances = np.empty(room + 1, np.float32)
    for sample in range(start, len(percepts)):
        nodes = counts[NODES]
        best, second = squared_distances(percepts, sample, prototype, first, nodes, distances)
        distance = np.sqrt(distances[max(best, 0)])
        if (
            nodes == room
            or counts[EDGES] + 2 > len(age)
            or (best != NO_NODE and max(degree[best], degree[max(second, 0)]) == lists.shape[1])
        ):
            _note_listed(here)
            return sample, NO_ROOM, counts[NODES], counts[EDGES]
        time[0] += 1
        winner[sample], runner_up[sample] = best, second
        activation[sample] = _activation(best, distance)
        if best == NO_NODE:
            _add_node(percepts, sample, here, rule)
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
            _insert(percepts, sample, best, second, here, rule)
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
        for place in range(degree[best]):
            edge = lists[best, place]
            if ends[edge, 0] + ends[edge, 1] - best == second:
                age[edge], joined = 0, True
        if not joined:
            _join(best, second, here)
        rate, decay = rule.winner_rate, rule.winner_decay
        node = best
        for place in range(-1, degree[best]):
            if place >= 0:
                edge = lists[best, place]
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
            if _drop_old_edges(here, rule, lonely) > 0:
                return sample + 1, LONELY, counts[NODES], counts[EDGES]
    _note_listed(here)
    return len(percepts), DONE, counts[NODES], counts[EDGES]


@njit
def _fits_together(percepts, here):
    """Whether no index can lie outside of an array, whatever has become of the map."""
    room, counts = here.prototype.shape[1], here.counts
    fits = percepts.shape[1] == len(here.prototype) and here.ends.shape[1] == 2
    fits &= len(here.habituation) >= room and len(here.habituated_at) >= room
    fits &= len(here.degree) >= room and len(here.lists) >= room
    fits &= len(here.ends) >= len(here.age) >= counts[EDGES]
    fits &= len(here.listed) >= len(here.age)
    return fits and counts[NODES] <= room


@njit
def _activation(winner, distance):
    return np.float32(0) if winner == NO_NODE else np.float32(np.exp(-np.float64(distance)))


@njit
def _insert(percepts, sample, winner, runner_up, here, rule):
    node = _add_node(percepts, sample, here, rule)
    _join(winner, node, here)
    if rule.insert_at_percept:
        return
    for d in range(percepts.shape[1]):
        middle = (here.prototype[d, winner] + percepts[sample, d]) / np.float32(2)
        here.prototype[d, node] = middle
    if runner_up != NO_NODE:
        _join(runner_up, node, here)
        edge = _edge_between(winner, runner_up, here)
        if edge != NO_NODE:
            _drop_edge(edge, here)


@njit
def _add_node(percepts, sample, here, rule):
    """At the percept; returns its number."""
    node = here.counts[NODES]
    for d in range(percepts.shape[1]):
        here.prototype[d, node] = percepts[sample, d]
    here.habituation[node], here.habituated_at[node] = rule.resting_habituation, NO_NODE
    here.degree[node] = 0
    here.counts[NODES] = node + 1
    return node


@njit
def _join(one, other, here):
    """Makes the edge between two nodes, or makes it young again."""
    if other == NO_NODE:
        return
    edge = _edge_between(one, other, here)
    if edge == NO_NODE:
        edge = here.counts[EDGES]
        here.counts[EDGES] = edge + 1
        here.ends[edge, 0], here.ends[edge, 1] = min(one, other), max(one, other)
        _list(edge, one, here)
        _list(edge, other, here)
    here.age[edge] = 0


@njit
def _edge_between(one, other, here):
    for place in range(here.degree[one]):
        edge = here.lists[one, place]
        if here.ends[edge, 0] + here.ends[edge, 1] - one == other:
            return edge
    return NO_NODE


@njit
def _list(edge, node, here):
    here.lists[node, here.degree[node]] = edge
    here.degree[node] += 1


@njit
def _place(edge, node, here):
    """Of an edge in the list of a node."""
    for place in range(here.degree[node]):
        if here.lists[node, place] == edge:
            return place
    return 0  # does not happen: the edge is listed at both of its ends


@njit
def _drop_edge(edge, here):
    """The last one takes its place."""
    last = here.counts[EDGES] - 1
    for end in range(2):
        node = here.ends[edge, end]
        place, behind = _place(edge, node, here), here.degree[node] - 1
        here.lists[node, place] = here.lists[node, behind]
        here.degree[node] = behind
    if edge != last:
        for end in range(2):
            node = here.ends[last, end]
            here.lists[node, _place(last, node, here)] = edge
            here.ends[edge, end] = node
        here.age[edge] = here.age[last]
    here.counts[EDGES] = last


@njit
def _drop_old_edges(here, rule, lonely):
    """Returns how many nodes it leaves without an edge; `lonely` says which."""
    count = 0
    for edge in range(here.counts[EDGES] - 1, -1, -1):
        if here.age[edge] > rule.max_edge_age:
            one, other = here.ends[edge, 0], here.ends[edge, 1]
            _drop_edge(edge, here)
            for node in (one, other):
                if here.degree[node] == 0:
                    lonely[count] = node
                    count += 1
    lonely[-1] = count
    return count


@njit
def _any_older(here, max_age):
    """Whether an edge is too old: none is after learning, but one may be that was loaded."""
    older = False
    for edge in range(here.counts[EDGES]):
        older |= here.age[edge] > max_age
    return older


@njit
def _list_edges(here):
    """Lists the edges of each node, unless these are the very edges that are listed."""
    listed = _are_listed(here)
    here.counts[LISTED] = NOT_LISTED  # from now on, until `learn` has noted what it did
    if listed:
        return DONE
    nodes, longest = here.counts[NODES], here.lists.shape[1]
    here.degree[:] = 0
    for edge in range(here.counts[EDGES]):
        one, other = here.ends[edge, 0], here.ends[edge, 1]
        if not (0 <= one < nodes and 0 <= other < nodes and one != other):
            return INVALID
        if max(here.degree[one], here.degree[other]) == longest:
            return NO_ROOM
        _list(edge, one, here)
        _list(edge, other, here)
    return DONE


@njit
def _note_listed(here):
    """Notes that the lists are of the edges as they are."""
    for edge in range(here.counts[EDGES]):
        for end in range(2):
            here.listed[edge, end] = here.ends[edge, end]
    here.counts[LISTED] = here.counts[NODES]


@njit
def _are_listed(here):
    """Whether the lists are of these very edges, of as many nodes: nobody has changed them."""
    changed = here.counts[LISTED] != here.counts[NODES]
    for edge in range(here.counts[EDGES]):
        for end in range(2):
            changed |= here.listed[edge, end] != here.ends[edge, end]
    return not changed
