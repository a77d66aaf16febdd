"""Kernels that keep targets within a budget; see `pacnet.schemas.merging`.

The targets of a node are a linked list of rows, so that one of them comes or goes without moving
the others. Each knows which later one of its node is nearest to it: a change of one target is
compared with the others once, and the two nearest of all are found without comparing all pairs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from pacnet.kernels.caching import cached_njit

MOST_SHOWN = 2**53
"""The most targets that are counted, as float64 counts them."""
_NO_NODE = -1  # `pacnet.attention.records.NO_NODE`, as a literal so that it is compiled in
_NONE = -1  # no row


class Rows(NamedTuple):
    """R targets: first the stored ones, node by node and in order, then the new ones."""

    cue: Any
    """Float64 `[R, D]`, whatever it is stored as, so that the kernel is compiled once."""
    target: Any
    """Float64 `[R, A]`."""
    count: Any
    """Number of targets shown that it is the mean of, int64 `[R]`; overwritten for new ones."""
    later: Any
    """The next row of its node, or −1, int64 `[R]`; only written."""
    nearest: Any
    """Of all later rows of its node the one with the nearest cue, int64 `[R]`; only written."""
    apart: Any
    """Squared distance from it, float64 `[R]`; only written."""


class Nodes(NamedTuple):
    """N nodes; int64 `[N]` each."""

    length: Any
    episode: Any
    habituated_at: Any
    forgotten: Any
    first: Any
    """Its first row; only written."""
    last: Any
    """Its last row; only written."""
    compared: Any
    """Whether `nearest` and `apart` of its rows are known; only written."""


@cached_njit(nogil=True)
def add_within_budget(node, habituated_at, episode, budget, single, rows, nodes):
    """Add T targets in order of time, each within the budget, and return the rows that are left.

    Args:
        node: of each target, in range, `[T]`.
        habituated_at: sample since when the node is habituated, or −1, `[T]`.
        episode: number of the learning episode.
        budget: number of targets, ≥ 1.
        single: whether a mean is rounded to float32, as it is stored.
        rows: changed in place.
        nodes: changed in place.

    Returns:
        Numbers of rows, node by node and in order, int64.
    """
    stored = total = _link(rows, nodes)
    for sample in range(len(node)):
        at = node[sample]
        total += _add(stored + sample, at, habituated_at[sample], episode, rows, nodes)
        while total > budget:
            _make_room(at, single, rows, nodes)
            total -= 1
    left, place = np.empty(total, np.int64), 0
    for at in range(len(nodes.length)):
        row = nodes.first[at]
        for _ in range(nodes.length[at]):
            left[place] = row
            row, place = rows.later[row], place + 1
    return left


@njit
def _link(rows, nodes):
    """Link the stored rows, and return how many there are."""
    row = 0
    for node in range(len(nodes.length)):
        nodes.first[node], nodes.compared[node] = row, 0
        for _ in range(nodes.length[node]):
            rows.later[row] = row + 1
            row += 1
        if nodes.length[node] > 0:
            nodes.last[node], rows.later[row - 1] = row - 1, _NONE
    return row


@njit
def _add(row, node, habituated_at, episode, rows, nodes):
    """Append a target by the rules of `MotorSchemas`; return how many more the node has then."""
    before = nodes.length[node]
    if nodes.episode[node] != episode:  # rule 3: the sequence is cleared
        nodes.episode[node] = episode
        nodes.length[node] = nodes.forgotten[node] = 0
    # As `pacnet.schemas.forgetting.count_replaced`.
    known = nodes.habituated_at[node] != _NO_NODE and habituated_at != _NO_NODE
    if known and nodes.habituated_at[node] != habituated_at:
        nodes.forgotten[node] = nodes.length[node]
    nodes.habituated_at[node] = habituated_at
    if nodes.forgotten[node] > 0 and nodes.length[node] > 0:
        _drop_first(node, rows, nodes)
    _append(row, node, rows, nodes)
    return nodes.length[node] - before


@njit
def _drop_first(node, rows, nodes):
    """Drop a forgotten target; no row before it refers to it."""
    nodes.forgotten[node] -= 1
    nodes.length[node] -= 1
    nodes.first[node] = rows.later[nodes.first[node]]


@njit
def _append(row, node, rows, nodes):
    rows.count[row], rows.later[row] = 1, _NONE
    rows.nearest[row], rows.apart[row] = _NONE, np.inf
    if nodes.length[node] == 0:
        nodes.first[node], nodes.compared[node] = row, 0
    else:
        rows.later[nodes.last[node]] = row
    if nodes.compared[node] == 1:
        other = nodes.first[node]
        while other != row:
            apart = _squared_distance(other, row, rows)
            if apart < rows.apart[other] or rows.nearest[other] == _NONE:
                rows.nearest[other], rows.apart[other] = row, apart
            other = rows.later[other]
    nodes.last[node] = row
    nodes.length[node] += 1


@njit
def _make_room(added, single, rows, nodes):
    """Make one target fewer, after one of the node `added` was appended."""
    node = 0
    for other in range(1, len(nodes.length)):
        if nodes.length[other] > nodes.length[node]:
            node = other
    if nodes.length[node] < 2:
        _forget_one(added, nodes)
    elif nodes.forgotten[node] > 0:
        _drop_first(node, rows, nodes)
    else:
        _merge_most_alike(node, single, rows, nodes)


@njit
def _forget_one(added, nodes):
    """Let the node forget its only target that is habituated for the longest time."""
    gone = added
    for node in range(len(nodes.length)):
        longer = gone == added or nodes.habituated_at[node] < nodes.habituated_at[gone]
        if node != added and nodes.length[node] > 0 and longer:
            gone = node
    nodes.length[gone] = nodes.forgotten[gone] = 0


@njit
def _merge_most_alike(node, single, rows, nodes):
    """Let the earlier of the two nearest targets be the mean of both; of equal pairs the first."""
    if nodes.compared[node] == 0:
        _compare_until(_NONE, nodes.first[node], rows)
        nodes.compared[node] = 1
    one = row = nodes.first[node]
    while row != _NONE:
        if rows.apart[row] < rows.apart[one]:
            one = row
        row = rows.later[row]
    other = rows.nearest[one]
    _average(one, other, single, rows)
    before = one
    while rows.later[before] != other:
        before = rows.later[before]
    rows.later[before] = rows.later[other]
    if nodes.last[node] == other:
        nodes.last[node] = before
    nodes.length[node] -= 1
    _compare_again(node, one, other, rows, nodes)


@njit
def _compare_again(node, one, other, rows, nodes):
    """Find the nearest later rows anew, where they change because `other` went into `one`."""
    row = nodes.first[node]
    while row != one:
        nearest = rows.nearest[row]
        # As near as another one: which of them is earlier is not known.
        if nearest in (one, other) or _squared_distance(row, one, rows) <= rows.apart[row]:
            _compare(row, rows)
        row = rows.later[row]
    _compare(one, rows)
    # Of the rows after `one`, those before `other` may refer to it.
    row, end = rows.later[one], rows.later[other]
    while row != end:
        if rows.nearest[row] == other:
            _compare(row, rows)
        row = rows.later[row]


@njit
def _compare_until(end, row, rows):
    while row != end:
        _compare(row, rows)
        row = rows.later[row]


@njit
def _compare(row, rows):
    """Find the nearest later row; of equally near ones the first."""
    other = rows.later[row]
    rows.nearest[row], rows.apart[row] = other, np.inf
    while other != _NONE:
        apart = _squared_distance(row, other, rows)
        if apart < rows.apart[row]:
            rows.nearest[row], rows.apart[row] = other, apart
        other = rows.later[other]


@njit
def _squared_distance(one, other, rows):
    total = 0.0
    for d in range(rows.cue.shape[1]):
        difference = rows.cue[one, d] - rows.cue[other, d]
        total += difference * difference
    return total


@njit
def _average(one, other, single, rows):
    """Write the mean of two targets, and of their cues, weighted by counts, in place of one."""
    both = rows.count[one] + rows.count[other]
    share = rows.count[other] / both
    for values in (rows.cue, rows.target):
        for k in range(values.shape[1]):
            mean = values[one, k] + share * (values[other, k] - values[one, k])
            values[one, k] = np.float64(np.float32(mean)) if single else mean
    rows.count[one] = min(both, MOST_SHOWN)
