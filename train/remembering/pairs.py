"""Cues with their targets, as the rules keep them: k-means keeps means of both."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from train.remembering.clusters import batch_means, online_means
from train.remembering.rules import RULES, Choice

Array = NDArray[np.float64]

_MEANS: dict[str, Callable[[Choice], NDArray[np.float64]]] = {
    "k-means": lambda one: batch_means(one.percepts, one.budget, one.rng),
    "k-means, online": lambda one: online_means(one.percepts, one.budget),
}


def kept_pairs(row: str, choice: Choice, targets: Array) -> tuple[Array, Array]:
    """Return the cues and the targets that a rule keeps, at most as many as the budget.

    Args:
        row: One of RULES.
        choice: What it chooses from.
        targets: Of each frame `[N, A]`.
    """
    cues = choice.percepts
    if row not in _MEANS:
        kept = RULES[row](choice)
        return cues[kept], targets[kept]
    means = _MEANS[row](choice)
    nearest = nearest_cues(means, cues)[:, 0]
    own = np.unique(nearest)
    return means[own], np.stack([targets[nearest == one].mean(axis=0) for one in own])


def nearest_cues(cues: Array, asked: Array, count: int = 1) -> NDArray[np.int64]:
    """Return the numbers of the nearest cues for each percept `[N, count]`."""
    rows = torch.from_numpy(np.ascontiguousarray(cues, np.float64))
    apart = torch.cdist(torch.from_numpy(asked), rows)
    return apart.topk(count, dim=1, largest=False).indices.numpy()
