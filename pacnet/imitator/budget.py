"""Which targets are kept where memory is bounded: attention decides.

A node of the map stands for a situation. What is novel gets a node of its own, and a node that has
been seen often is habituated: more of the same adds little. So all nodes may keep equally many
targets, and those that keep fewer leave their share to the others. Of a node's targets those are
kept that lie evenly over what was shown.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def kept_rows(node: NDArray[np.int64], budget: int) -> NDArray[np.bool_]:
    """Return which of the rows are kept, bool `[R]`: as many as the budget if there are more.

    Args:
        node: of each row, `[R]`, ≥ 0; rows are in the order in which they were shown.
        budget: most rows that are kept.
    """
    counts = np.bincount(node)
    order = np.argsort(node, kind="stable")
    kept = np.zeros(len(node), bool)
    for rows, share in zip(
        np.split(order, np.cumsum(counts)[:-1]), shares(counts, budget), strict=True
    ):
        if share:
            places = (np.arange(share) + 0.5) * len(rows) / share
            kept[rows[places.astype(np.int64)]] = True
    return kept


def shares(counts: NDArray[np.int64], budget: int) -> NDArray[np.int64]:
    """Return how many of each node's rows `[N]` are kept, as equally many as there are."""
    left, share = budget, np.zeros_like(counts)
    for place, node in enumerate(np.argsort(counts, kind="stable")):
        share[node] = min(int(counts[node]), left // (len(counts) - place))
        left -= int(share[node])
    return share
