"""What the map says of a percept, and what it did with it: the records that the stages exchange."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

NO_NODE = -1
"""Stands for "no node": the winner of an empty map, the runner-up of a map of one node."""


class Attention(NamedTuple):
    """What the map says of each percept. B percepts."""

    winner: Tensor
    """Nearest node, int64 `[B]`, or `NO_NODE`."""
    runner_up: Tensor
    """Second nearest node, int64 `[B]`, or `NO_NODE`."""
    activation: Tensor
    """exp(−distance to the winner), `[B]`, in (0, 1]; 0 where the map is empty."""
    novelty: Tensor
    """Whether the activation is under the novelty threshold, bool `[B]`."""


class Observation(NamedTuple):
    """What the map said of each percept before it learned it, and what it then did. T percepts."""

    winner: Tensor
    """Nearest node, int64 `[T]`, as numbered at that sample, or `NO_NODE`."""
    runner_up: Tensor
    """Second nearest node, int64 `[T]`, as numbered at that sample, or `NO_NODE`."""
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
    """Whether the winner had been habituated for the forgetting interval and responds again."""
    deleted: Tensor
    """Number of nodes that went with their last edge, int64 `[T]`."""


class Response(NamedTuple):
    """What the map did with one percept."""

    attention: Attention  # of one percept, B = 1
    inserted: bool = False
    ignored: bool = False
    dishabituated: bool = False
    habituated: bool = False  # whether the winner was fully habituated when it matched
    deleted: Tensor | None = None  # numbers of the nodes that went, int64 [K], before they went


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
    """An observation, with what must be known by whoever keeps something of each node."""

    observation: Observation
    habituated: Tensor
    """Whether the winner was fully habituated when it matched, bool `[T]`."""
    gone: Tensor
    """Numbers of the nodes that went, int64 `[sum of deleted]`: sample after sample, ascending,
    as they were before those of that sample went."""

    def between_deletions(self) -> Iterator[tuple[slice, Tensor]]:
        """Stretches of samples over which no node changes its number, and the nodes that then go.

        Yields:
            The samples of a stretch, and numbers `[K]` of the nodes that went at its last one.
        """
        deleted = self.observation.deleted
        samples, start, first = len(deleted), 0, 0
        for last in [*deleted.nonzero().flatten().tolist(), samples - 1]:
            if start < samples:
                after = first + int(deleted[last])
                yield slice(start, last + 1), self.gone[first:after]
                start, first = last + 1, after


def record(responses: list[Response]) -> MapUpdate:
    """Joins the responses to T percepts into one record."""
    fields = zip(*(response.attention for response in responses), strict=True)
    attention = Attention(*(torch.cat(field) for field in fields))
    device = attention.winner.device
    ignored = torch.tensor([r.ignored for r in responses], device=device)
    gone = [r.deleted for r in responses if r.deleted is not None]
    observation = Observation(
        *attention,
        attended=~ignored,
        inserted=torch.tensor([r.inserted for r in responses], device=device),
        ignored=ignored,
        dishabituated=torch.tensor([r.dishabituated for r in responses], device=device),
        deleted=torch.tensor(
            [0 if r.deleted is None else len(r.deleted) for r in responses], device=device
        ),
    )
    return MapUpdate(
        observation,
        habituated=torch.tensor([r.habituated for r in responses], device=device),
        gone=torch.cat(gone) if gone else torch.zeros(0, dtype=torch.int64, device=device),
    )


def ignored(attention: Attention) -> MapUpdate:
    """What a map that does not learn does with T percepts: nothing."""
    nothing = torch.zeros_like(attention.novelty)
    number = torch.zeros_like(attention.winner)
    observation = Observation(
        *attention,
        attended=nothing,
        inserted=nothing.clone(),
        ignored=~nothing,
        dishabituated=nothing.clone(),
        deleted=number,
    )
    return MapUpdate(observation, habituated=nothing.clone(), gone=number[:0].clone())
