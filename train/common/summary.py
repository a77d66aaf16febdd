"""Mean and standard deviation of scores over replicates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypedDict

import numpy as np


class Summary(TypedDict):
    """One score over replicates."""

    mean: float
    std: float  # sample standard deviation (n - 1); 0 for one replicate
    values: list[float]  # of each replicate, in order


def summarise(replicates: Sequence[Mapping[str, float]]) -> dict[str, Summary]:
    """Return mean and sample standard deviation of each score over replicates.

    Raises:
        ValueError: No replicates, or replicates with different scores.
    """
    if not replicates or any(scores.keys() != replicates[0].keys() for scores in replicates):
        got = [sorted(scores) for scores in replicates]
        raise ValueError(f"expected one or more replicates with the same scores, got {got}")
    return {
        name: _summary([float(scores[name]) for scores in replicates]) for name in replicates[0]
    }


def _summary(values: list[float]) -> Summary:
    std = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return {"mean": float(np.mean(values)), "std": std, "values": values}
