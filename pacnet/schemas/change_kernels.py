"""Kernels that measure how a percept has changed lately; see `pacnet.schemas.changes`."""

from __future__ import annotations

from numba import njit

from pacnet.kernels.caching import cached_njit


@cached_njit(nogil=True)
def changes_of(percepts, kept, count, least, changes):
    """Write the change at each of an episode's percepts `[T, D]`."""
    for frame in range(len(percepts)):
        change_at(percepts[frame], kept, count, least, changes[frame])


@njit
def change_at(percept, kept, count, least, change):
    """Take one more percept `[D]` and write its change.

    Args:
        percept: scaled.
        kept: the last percepts that lie apart, a ring `[H, D]`.
        count: how many there have been so far, `[1]`.
        least: distance from which a percept lies apart from the last one kept.
        change: where to write, `[D]`.
    """
    size, number = len(kept), count[0]
    squared = 0.0
    if number > 0:
        last = kept[(number - 1) % size]
        for k in range(len(percept)):
            squared += (percept[k] - last[k]) ** 2
    if number == 0 or squared >= least * least:
        kept[number % size] = percept
        count[0] = number = number + 1
    oldest = kept[max(0, number - size) % size]
    for k in range(len(percept)):
        change[k] = percept[k] - oldest[k]
