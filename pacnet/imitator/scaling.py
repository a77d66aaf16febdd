"""The scale of percepts: each dimension is divided by its own noise.

Distances sum over the dimensions, so these must be comparable. Dividing by the standard deviation
would amplify dimensions that are mostly noise, such as the velocity of a joint at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

_MIN_NOISE = 1 / 50  # of a dimension, in shares of its standard deviation
_MEDIAN_OF_NORMAL = 0.6745  # median of |x| of a standard normal
_STD_OF_SECOND_DIFFERENCES = math.sqrt(6.0)  # x[t + 1] − 2 x[t] + x[t − 1] of white noise of 1


class Scaling(NamedTuple):
    """Factors that make the D dimensions of percepts comparable."""

    scale: tuple[float, ...]
    """Factor on each dimension; scaled percepts have a quadratic mean distance of 1 from their
    mean."""
    noise: float
    """Length of the noise of a scaled percept."""


def noise_scaling(episodes: Sequence[Tensor]) -> Scaling:
    """Return a scale from the noise of each dimension and its spread over all frames.

    The noise is the median of second differences, which neither steady movement nor rare jumps
    affect, and at least a fiftieth of the dimension's spread. A dimension that never changes gets
    the median factor of the others.

    Args:
        episodes: percepts of each, `[T ≥ 1, D]`, in order of time.

    Raises:
        ValueError: no episode, or no dimension that changes.
    """
    if not episodes:
        raise ValueError("expected at least one episode to choose the scale from, got none")
    spread = torch.cat([episode.double() for episode in episodes]).std(dim=0, correction=0)
    moves = spread > 0
    if not bool(moves.any()):
        raise ValueError("expected percepts that change, got the same one in every frame")
    noise = torch.maximum(_noise(episodes), _MIN_NOISE * spread)
    factor = 1 / noise.masked_fill(~moves, 1.0)
    factor[~moves] = factor[moves].median()
    factor /= torch.linalg.vector_norm((factor * spread)[moves])
    return Scaling(tuple(factor.tolist()), float(torch.linalg.vector_norm((factor * noise)[moves])))


def _noise(episodes: Sequence[Tensor]) -> Tensor:
    """Return the standard deviation of the noise, float64 `[D]`; 0 if episodes are too short."""
    differences = torch.cat([episode.double().diff(n=2, dim=0) for episode in episodes])
    if len(differences) == 0:
        return episodes[0].new_zeros(episodes[0].shape[1], dtype=torch.float64)
    return differences.abs().median(dim=0).values / (_MEDIAN_OF_NORMAL * _STD_OF_SECOND_DIFFERENCES)
