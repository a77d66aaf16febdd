"""A recall episode of competing schemas: which one wins, and its current target.

The network may learn meanwhile: the episode works on what was known when it began.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.attention.records import NO_NODE
from pacnet.competition.belief import Belief
from pacnet.competition.confidences import SchemaConfidences
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.competition.timeline import Timeline
from pacnet.competition.winner_take_all import NO_SCHEMA, Competition, CompetitionConfig
from pacnet.schemas.interface import Target
from pacnet.schemas.memory import EpisodicMemory


class CompetingRecall:
    """A recall episode, sample by sample.

    Args:
        memory: the schemas, in a pool without gaps; nothing changes them later.
        config: of recall.
        timeline: of the episodes in memory.

    Attributes:
        belief: the probability of each state of each known episode.
        cues: of all schemas, `[R, D]`.
    """

    def __init__(
        self, memory: EpisodicMemory, config: CompetingSchemasConfig, timeline: Timeline
    ) -> None:
        memory.check()
        self.memory, self.config, self.timeline = memory, config, timeline
        self.cues = np.asfortranarray(memory.arrays("cue"))  # the layout distances are taken in
        self._targets = memory.arrays("target")
        self._competition = Competition(CompetitionConfig(config.threshold, config.margin))
        # All schemas, each confident near its own cues alone, and their nodes.
        node = memory.blocks.live("node")
        reach = -math.log(1 - config.recognition.novel_above)
        ids = torch.arange(len(node), device=node.device)
        self._everywhere = SchemaConfidences(memory, ids, timeline, reach)
        self._node_of = node.numpy(force=True)
        self._at_nodes: dict[int, SchemaConfidences | None] = {}  # those that have won
        self.reset()

    def reset(self) -> None:
        """Start a new episode."""
        self.belief = Belief(self.timeline, self.config.recognition)
        self.incumbent = NO_SCHEMA  # the schema that won last

    def distances(self, percept: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the distances of a normalized percept `[D]` from every cue, `[R]`."""
        from pacnet.kernels.distances import distances_of  # imports numba

        return distances_of(percept, self.cues)

    def recall(self, node: int, percept: NDArray[np.floating]) -> Target | None:
        """See `CompetingSchemas.recall_one`."""
        distances = self.distances(percept)
        self.belief.update(distances)
        rows = self._compete(node, distances)
        if rows is None:
            return None
        nearest = distances[rows].argsort(kind="stable")[: self.config.nearest_cues]
        chosen = self._targets[rows][nearest]
        target = chosen.sum(axis=0) / chosen.dtype.type(len(nearest))
        return Target(target, int(nearest[0]), self.incumbent)

    def _compete(self, node: int, distances: NDArray[np.floating]) -> slice | None:
        """Let the node's schemas compete, then all; return the pool's rows of the winning one."""
        if node == NO_NODE:
            return None
        for here in self._candidates(node):
            confidences = here.confidences(distances, self.belief.probability)
            winner = self._competition.winner(confidences, here.index_of(self.incumbent))
            if winner != NO_SCHEMA:
                self.incumbent = here.ids[winner]
                return here.rows_of(winner)
        self.incumbent = NO_SCHEMA
        return None

    def _candidates(self, node: int) -> Iterator[SchemaConfidences]:
        """Yield the schemas of a node, then all of them."""
        here = self._at_node(node)
        if here is not None:
            yield here
        yield self._everywhere

    def _at_node(self, node: int) -> SchemaConfidences | None:
        """Return the schemas of a node, cached from its first win on; None if it has none."""
        if node not in self._at_nodes:
            indices = np.flatnonzero(self._node_of == node)
            self._at_nodes[node] = self._everywhere.part(indices) if len(indices) > 0 else None
        return self._at_nodes[node]
