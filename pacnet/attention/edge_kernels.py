"""The map's memory as arrays, and the kernels of its edges, which `kernels.learn` calls.

N nodes and E edges are in use, of a capacity of C and F. Beside the edges, each node has a list of
the edges that end at it: a search among all edges would take longer than everything else.

Numba's cache of `learn` does not depend on this file: run `make clean` after changing it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

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


@njit
def join(one, other, arrays):
    """Make an edge between two nodes, or set its age to 0."""
    if other == NO_NODE:
        return
    edge = edge_between(one, other, arrays)
    if edge == NO_NODE:
        edge = arrays.counts[EDGES]
        arrays.counts[EDGES] = edge + 1
        arrays.ends[edge, 0], arrays.ends[edge, 1] = min(one, other), max(one, other)
        _list(edge, one, arrays)
        _list(edge, other, arrays)
    arrays.age[edge] = 0


@njit
def edge_between(one, other, arrays):
    """Return the index of the edge between two nodes, or NO_NODE."""
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
def drop_edge(edge, arrays):
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
def drop_old_edges(arrays, rule, isolated):
    """Delete old edges; write the nodes left without an edge to `isolated`, return their number."""
    count = 0
    for edge in range(arrays.counts[EDGES] - 1, -1, -1):
        if arrays.age[edge] > rule.max_edge_age:
            one, other = arrays.ends[edge, 0], arrays.ends[edge, 1]
            drop_edge(edge, arrays)
            for node in (one, other):
                if arrays.degree[node] == 0:
                    isolated[count] = node
                    count += 1
    isolated[-1] = count
    return count


@njit
def list_edges(arrays):
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
def note_listed(arrays):
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
