"""Confidences of several schemas, given a percept and the belief."""

from __future__ import annotations

import copy
import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.competition.timeline import Timeline
from pacnet.competition.winner_take_all import NO_SCHEMA
from pacnet.schemas.memory import EpisodicMemory


class SchemaConfidences:
    """The confidences of some schemas, with the arrays that do not change during recall.

    Args:
        memory: the schemas of all nodes, in a pool without gaps.
        ids: of these schemas, int64 `[K ≥ 1]`.
        timeline: of the known episodes.
        reach: distance from its nearest cue beyond which a schema does not compete.
    """

    def __init__(
        self, memory: EpisodicMemory, ids: Tensor, timeline: Timeline, reach: float = math.inf
    ) -> None:
        self.ids: list[int] = ids.tolist()
        self._reach = reach
        starts, lengths = memory.blocks.live("start")[ids], memory.lengths[ids]
        # First row of each schema and the row after its last, [K, 2].
        self._spans = torch.stack([starts, starts + lengths], dim=1).numpy(force=True)
        index = torch.full((len(memory.blocks),), NO_SCHEMA, device=ids.device)
        index[ids] = torch.arange(len(ids), device=ids.device)
        schema = index[memory.visits.live("schema")]
        visits = (schema != NO_SCHEMA).nonzero().flatten()
        first, last = _states(memory, visits, timeline)
        # First and last state of each visit, and the index of its schema, [N, 3].
        self._visits = torch.stack([first, last, schema[visits]], dim=1).numpy(force=True)

    def part(self, indices: NDArray[np.int64]) -> SchemaConfidences:
        """Return those at ascending indices `[K ≥ 1]`, with unlimited reach."""
        part = copy.copy(self)
        part.ids, part._reach = [self.ids[index] for index in indices.tolist()], math.inf
        part._spans = np.ascontiguousarray(self._spans[indices])
        index = np.full(len(self.ids), NO_SCHEMA)
        index[indices] = np.arange(len(indices))
        schema = index[self._visits[:, 2]]
        part._visits = np.ascontiguousarray(self._visits[schema != NO_SCHEMA])
        part._visits[:, 2] = schema[schema != NO_SCHEMA]
        return part

    def index_of(self, schema: int) -> int:
        """Return the index of a schema among these; `NO_SCHEMA` where it is none of them."""
        return self.ids.index(schema) if schema in self.ids else NO_SCHEMA

    def rows_of(self, index: int) -> slice:
        """Return the pool's rows of the schema at this index."""
        return slice(*self._spans[index].tolist())

    def confidences(
        self, distances: NDArray[np.floating], probability: NDArray[np.float64]
    ) -> NDArray[np.floating]:
        """Return the probability of a visit to each, times its activation by the percept.

        Args:
            distances: of the percept from every cue of the pool, `[R]`.
            probability: of every state of every known episode, `[E, P]`.

        Returns:
            `[K]`, in [0, 1], or `OUT_OF_REACH`.
        """
        from pacnet.competition import kernels  # imports numba

        confidences = np.empty(len(self.ids), distances.dtype)
        fits = kernels.confidences_of(
            probability.ravel(), self._visits, distances, self._spans, self._reach, confidences
        )
        if not fits:
            raise ValueError(
                f"expected distances and probabilities of all that is known, got "
                f"{len(distances)} and {probability.size}"
            )
        return confidences


def _states(memory: EpisodicMemory, visits: Tensor, timeline: Timeline) -> tuple[Tensor, Tensor]:
    """Return the first and the last state of each visit in the flattened timeline."""
    episode = memory.visits.live("episode")[visits]
    samples, states = memory.episodes.live("samples")[episode], timeline.rows.shape[1]
    first, last = memory.visits.live("first")[visits], memory.visits.live("last")[visits]
    first, end = first * states // samples, (last + 1) * states // samples - 1
    last = torch.maximum(end, last * states // samples)  # a sample may span several states or none
    known = torch.from_numpy(timeline.episode).to(episode.device)
    begin = torch.searchsorted(known, episode) * states
    return begin + first, begin + last
