"""Records of what the map reads of percepts and of what it learns from them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

NO_NODE = -1
"""No node: the winner of an empty map, the runner-up of a map of one node."""


class Attention(NamedTuple):
    """What the map reads of each of B percepts."""

    winner: Tensor
    """Nearest node, int64 `[B]`, or `NO_NODE`."""
    runner_up: Tensor
    """Second nearest node, int64 `[B]`, or `NO_NODE`."""
    activation: Tensor
    """exp(−distance to the winner), `[B]`, in (0, 1]; 0 where the map is empty."""
    novelty: Tensor
    """Whether the activation is under the novelty threshold, bool `[B]`."""


class Observation(NamedTuple):
    """What the map read of each of T percepts before it learned it, and what it then did."""

    winner: Tensor
    """Nearest node, int64 `[T]`, with its index at that sample, or `NO_NODE`."""
    runner_up: Tensor
    """Second nearest node, int64 `[T]`, with its index at that sample, or `NO_NODE`."""
    activation: Tensor
    """exp(−distance to the winner), `[T]`."""
    novelty: Tensor
    """Whether the activation was under the novelty threshold, bool `[T]`."""
    attended: Tensor
    """Whether the map responded (cases 1 and 2), bool `[T]`."""
    inserted: Tensor
    """Whether it made a node (case 1), bool `[T]`."""
    ignored: Tensor
    """Whether it did not respond (case 3), bool `[T]`; the opposite of `attended`."""
    dishabituated: Tensor
    """Whether the winner was dishabituated after the forgetting interval, bool `[T]`."""
    deleted: Tensor
    """Number of nodes that were deleted with their last edge, int64 `[T]`."""


class Step(NamedTuple):
    """`Observation` of one percept, as plain numbers."""

    winner: int
    runner_up: int
    activation: float
    novelty: bool
    attended: bool
    inserted: bool
    ignored: bool
    dishabituated: bool
    deleted: int


class MapUpdate(NamedTuple):
    """An observation, and which nodes were deleted, for modules with data about each node."""

    observation: Observation
    habituated: Tensor
    """Whether the winner was fully habituated when it matched, bool `[T]`."""
    habituated_at: Tensor
    """Sample since when it was, int64 `[T]`; `NO_NODE` while it responds."""
    deleted_nodes: dict[int, Tensor]
    """Sample, ascending -> the nodes deleted after it, int64 `[K]`, ascending, with their indices
    before the deletion."""

    def between_deletions(self) -> Iterator[tuple[slice, Tensor]]:
        """Split the samples into stretches over which no node changes its index.

        Yields:
            The samples of a stretch, and the nodes `[K]` that are deleted after its last one.
        """
        start, samples = 0, len(self.habituated)
        for last, nodes in self.deleted_nodes.items():
            yield slice(start, last + 1), nodes
            start = last + 1
        if start < samples:
            yield slice(start, samples), self.observation.deleted.new_empty(0)


def observation_of(
    attention: Attention,
    inserted: Tensor,
    ignored: Tensor,
    dishabituated: Tensor,
    deleted_nodes: dict[int, Tensor],
) -> Observation:
    """Join what the map read of T percepts and what it did with them."""
    deleted = torch.zeros_like(attention.winner)
    for sample, nodes in deleted_nodes.items():
        deleted[sample] = len(nodes)
    return Observation(*attention, ~ignored, inserted, ignored, dishabituated, deleted)


def ignored(attention: Attention) -> Observation:
    """Return the observation of a map that does not learn: it ignores every percept."""
    no = torch.zeros_like(attention.novelty)
    return observation_of(attention, no, ~no, no.clone(), {})
