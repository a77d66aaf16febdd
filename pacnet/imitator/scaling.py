"""The scale of percepts nobody has tuned: each dimension is measured in units of its own noise.

The map's distances add up over the dimensions, so these must be made comparable. Dividing by the
standard deviation would blow up what only trembles, such as the velocity of a joint at rest. In
units of its noise a dimension counts by as much as it says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

_FINEST = 1 / 50  # noise of a dimension, at least, in shares of its standard deviation
_OF_MEDIAN = 0.6745  # median of |x| of a standard normal
_OF_SECOND_DIFFERENCES = math.sqrt(6.0)  # std of x[t + 1] − 2 x[t] + x[t − 1] for white noise of 1


class Scaling(NamedTuple):
    """How percepts of D dimensions are made comparable."""

    scale: tuple[float, ...]
    """Factor on each dimension; with it the percepts are 1 away from their mean, in quadratic
    mean."""
    noise: float
    """Length of the noise of a percept, scaled."""


def noise_scaling(episodes: Sequence[Tensor]) -> Scaling:
    """Measures the noise of each dimension from frame to frame, and its spread over all frames.

    The noise is told from movement by second differences, which steady movement does not have; by
    their median, which rare jumps do not move. It counts as at least a fiftieth of the dimension's
    spread. A dimension that never changes says nothing about its unit: it gets the median factor
    of the others.

    Args:
        episodes: percepts of each, `[T ≥ 1, D]`, in order of time.

    Raises:
        ValueError: no episode, or no dimension that changes.
    """
    if not episodes:
        raise ValueError("expected at least one episode to take the scale from, got none")
    spread = torch.cat([episode.double() for episode in episodes]).std(dim=0, correction=0)
    moves = spread > 0
    if not bool(moves.any()):
        raise ValueError("expected percepts that change, got the same one in every frame")
    noise = torch.maximum(_noise(episodes), _FINEST * spread)
    factor = 1 / noise.masked_fill(~moves, 1.0)
    factor[~moves] = factor[moves].median()
    factor /= torch.linalg.vector_norm((factor * spread)[moves])
    return Scaling(tuple(factor.tolist()), float(torch.linalg.vector_norm((factor * noise)[moves])))


def _noise(episodes: Sequence[Tensor]) -> Tensor:
    """Standard deviation of what is not movement, float64 `[D]`; 0 if episodes are too short."""
    bends = torch.cat([episode.double().diff(n=2, dim=0) for episode in episodes])
    if len(bends) == 0:
        return episodes[0].new_zeros(episodes[0].shape[1], dtype=torch.float64)
    return bends.abs().median(dim=0).values / (_OF_MEDIAN * _OF_SECOND_DIFFERENCES)
