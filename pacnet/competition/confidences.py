"""The schemas of one node, laid out for recall: how confident each of them is."""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.competition.belief import Timeline
from pacnet.competition.winner_take_all import NO_SCHEMA

OUT_OF_REACH = -1.0  # a confidence under every threshold

if TYPE_CHECKING:
    from pacnet.competition.competing_schemas import CompetingSchemas


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
        # The first row of each schema and the one behind its last, [K, 2].
        self._spans = torch.stack([starts, starts + lengths], dim=1).numpy(force=True)
        place = torch.full((len(schemas.blocks),), NO_SCHEMA, device=numbers.device)
        place[numbers] = torch.arange(len(numbers), device=numbers.device)
        schema = place[schemas.passes.live("schema")]
        passes = (schema != NO_SCHEMA).nonzero().flatten()
        schema = schema[passes]
        first, last = _places(schemas, passes, timeline)
        # The first and the last place of each pass, and the schema that it passes, [N, 3].
        self._passes = torch.stack([first, last, schema], dim=1).numpy(force=True)

    def part(self, places: NDArray[np.int64]) -> NodeSchemas:
        """Some of these, at ascending places `[K ≥ 1]`, each confident however far its cues are."""
        part = copy.copy(self)
        part.numbers, part._reach = [self.numbers[place] for place in places.tolist()], math.inf
        part._spans = np.ascontiguousarray(self._spans[places])
        place = np.full(len(self.numbers), NO_SCHEMA)
        place[places] = np.arange(len(places))
        schema = place[self._passes[:, 2]]
        part._passes = np.ascontiguousarray(self._passes[schema != NO_SCHEMA])
        part._passes[:, 2] = schema[schema != NO_SCHEMA]
        return part

    def place_of(self, schema: int) -> int:
        """The place of a schema among the node's own; `NO_SCHEMA` where it is none of them."""
        return self.numbers.index(schema) if schema in self.numbers else NO_SCHEMA

    def rows_of(self, place: int) -> slice:
        """The rows of the pool of the schema at this place."""
        return slice(*self._spans[place].tolist())

    def confidences(
        self, distances: NDArray[np.floating], probability: NDArray[np.float64]
    ) -> NDArray[np.floating]:
        """The probability that what is watched is a pass through each, times how well it fits.

        Args:
            distances: of the percept from every cue of the pool, `[R]`.
            probability: of every place of every known episode, `[E, P]`.

        Returns:
            `[K]`, in [0, 1], or `OUT_OF_REACH`.

        Raises:
            ValueError: fewer distances or places than there were when this was laid out.
        """
        from pacnet.competition import kernels as recall_kernels  # which brings numba

        confidences = np.empty(len(self.numbers), distances.dtype)
        fits = recall_kernels.compete(
            probability.ravel(), self._passes, distances, self._spans, self._reach, confidences
        )
        if not fits:
            raise ValueError(
                f"expected distances and probabilities of all that is known, got "
                f"{len(distances)} and {probability.size}"
            )
        return confidences


def _places(schemas: CompetingSchemas, passes: Tensor, timeline: Timeline) -> tuple[Tensor, Tensor]:
    """The first and the last place of each pass in the flattened timeline."""
    episode = schemas.passes.live("episode")[passes]
    samples, places = schemas.episodes.live("samples")[episode], timeline.rows.shape[1]
    first, last = schemas.passes.live("first")[passes], schemas.passes.live("last")[passes]
    first, end = first * places // samples, (last + 1) * places // samples - 1
    last = torch.maximum(end, last * places // samples)  # a sample may span many places or none
    known = torch.from_numpy(timeline.episode).to(episode.device)
    begin = torch.searchsorted(known, episode) * places
    return begin + first, begin + last
