"""The schemas of one node, laid out for recall: how confident each of them is."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from pacnet.attention import NOBODY
from pacnet.belief import Timeline

OUT_OF_REACH = -1.0  # a confidence under every threshold

if TYPE_CHECKING:
    from pacnet.competing_schemas import CompetingSchemas


class NodeSchemas:
    """What of a node's schemas does not change while nothing is learned.

    Args:
        schemas: of all nodes, the pool without gaps.
        numbers: of the node's own, int64 `[K ≥ 1]`.
        timeline: of the known episodes.
        reach: distance from the nearest of its cues beyond which a schema does not compete.

    Attributes:
        numbers: of the node's schemas.
    """

    def __init__(
        self,
        schemas: CompetingSchemas,
        numbers: Tensor,
        timeline: Timeline,
        reach: float = math.inf,
    ) -> None:
        self.numbers: list[int] = numbers.tolist()
        self._reach = reach
        starts, lengths = schemas.blocks.live("start")[numbers], schemas.lengths[numbers]
        self._starts, self._lengths = starts, lengths
        self._blocks = [
            slice(start, start + length)
            for start, length in zip(starts.tolist(), lengths.tolist(), strict=True)
        ]
        through = schemas.passes.live("schema")[:, None] == numbers  # [passes, K]
        passes, self._through = through.nonzero().unbind(dim=1)
        self._first, self._last = _places(schemas, passes, timeline)
        self._has_before = (self._first % timeline.rows.shape[1] > 0).double()

    @cached_property
    def _rows(self) -> Tensor:
        """The rows of each in the pool, `[K, longest]`; the last one stands for those it lacks."""
        place = torch.arange(int(self._lengths.max()), device=self._starts.device)
        return self._starts[:, None] + torch.minimum(place, self._lengths[:, None] - 1)

    def place_of(self, schema: int) -> int:
        """The place of a schema among the node's own; `NOBODY` where it is none of them."""
        return self.numbers.index(schema) if schema in self.numbers else NOBODY

    def rows_of(self, place: int) -> slice:
        """The rows of the pool of the schema at this place."""
        return self._blocks[place]

    def confidences(self, distances: Tensor, probability: Tensor) -> Tensor:
        """The probability that what is watched is a pass through each, times how well it fits.

        Args:
            distances: of the percept from every cue of the pool, `[R]`.
            probability: of every place of every known episode, `[E, P]`.

        Returns:
            `[K]`, in [0, 1], or `OUT_OF_REACH`.
        """
        nearest = distances.take(self._rows).amin(dim=1)
        confidences = self.watched(probability).to(nearest.dtype).clamp_(max=1) * (-nearest).exp()
        return confidences.where(nearest <= self._reach, OUT_OF_REACH)

    def watched(self, probability: Tensor) -> Tensor:
        """The probability that what is watched is a pass through each, `[K]`.

        Args:
            probability: of every place of every known episode, `[E, P]`.
        """
        until = probability.cumsum(dim=1)
        before = until.take((self._first - 1).clamp_(min=0)) * self._has_before
        within = until.take(self._last) - before
        return within.new_zeros(len(self.numbers)).index_add_(0, self._through, within)


def _places(schemas: CompetingSchemas, passes: Tensor, timeline: Timeline) -> tuple[Tensor, Tensor]:
    """The first and the last place of each pass in the flattened timeline."""
    episode = schemas.passes.live("episode")[passes]
    samples, places = schemas.episodes.live("samples")[episode], timeline.rows.shape[1]
    first, last = schemas.passes.live("first")[passes], schemas.passes.live("last")[passes]
    first, end = first * places // samples, (last + 1) * places // samples - 1
    last = torch.maximum(end, last * places // samples)  # a sample may span many places or none
    begin = torch.searchsorted(timeline.episode, episode) * places
    return begin + first, begin + last
