"""Which targets are kept where memory is bounded: attention decides.

A node of the map stands for a kind of situation. What is novel gets a node of its own; of a
situation that is seen again and again, more of the same adds little. So all situations of all tasks
may keep equally many targets, and those that have fewer leave their share to the others. The same
holds for the demonstrations within a situation. Of one demonstration in one situation, targets are
kept that lie evenly over it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def kept_rows(
    situation: NDArray[np.int64], demonstration: NDArray[np.int64], budget: int
) -> NDArray[np.bool_]:
    """Return which of the rows are kept, bool `[R]`: as many as the budget if there are more.

    Args:
        situation: of each row, `[R]`; rows are in the order in which they were shown.
        demonstration: of each row, `[R]`.
        budget: most rows that are kept.
    """
    kept = np.zeros(len(situation), bool)
    for rows, share in _shared_out(np.arange(len(situation)), situation, budget):
        for part, few in _shared_out(rows, demonstration, share):
            places = (np.arange(few) + 0.5) * len(part) / max(few, 1)
            kept[part[places.astype(np.int64)]] = True
    return kept


def _shared_out(
    rows: NDArray[np.int64], of: NDArray[np.int64], budget: int
) -> list[tuple[NDArray[np.int64], int]]:
    """Return the rows of each kind, and how many of them are kept."""
    _, kind, counts = np.unique(of[rows], return_inverse=True, return_counts=True)
    parts = np.split(rows[np.argsort(kind, kind="stable")], np.cumsum(counts)[:-1])
    return list(zip(parts, shares(counts, budget).tolist(), strict=True))


def shares(counts: NDArray[np.int64], budget: int) -> NDArray[np.int64]:
    """Return how many of each kind `[N]` are kept: equally many, as far as there are."""
    left, share = budget, np.zeros_like(counts)
    for place, kind in enumerate(np.argsort(counts, kind="stable")):
        share[kind] = min(int(counts[kind]), -(-left // (len(counts) - place)))
        left -= int(share[kind])
    return share
