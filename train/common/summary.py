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


def mean_and_std(score: Summary, digits: int = 2, factor: float = 1.0) -> str:
    """Return a score as text: the mean, and ± the deviation where there are several replicates.

    Args:
        score: Over replicates.
        digits: After the decimal point.
        factor: On mean and deviation, to show them in another unit.
    """
    spread = f" ± {factor * score['std']:.{digits}f}" if len(score["values"]) > 1 else ""
    return f"{factor * score['mean']:.{digits}f}{spread}"


def _summary(values: list[float]) -> Summary:
    std = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return {"mean": float(np.mean(values)), "std": std, "values": values}
