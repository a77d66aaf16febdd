"""A recall episode of schemas that compete: which of the winner's gives the target, and which one.

The network and the schemas may go on learning meanwhile: it works on what was known when it began.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.attention.records import NO_NODE
from pacnet.competition.belief import Belief, Timeline
from pacnet.competition.confidences import NodeSchemas
from pacnet.competition.explanation import Rival, rivals_of
from pacnet.schemas.sequences import RecalledRow

if TYPE_CHECKING:
    from pacnet.competition.competing_schemas import CompetingSchemas


class CompetingRecall:
    """Goes on from sample to sample.

    Args:
        schemas: that compete, the pool without gaps; they do not change any more.
        timeline: of the episodes that they know.

    Attributes:
        belief: which of these is being watched, and how far it is.
        cues: of all of them, `[R, D]`.
    """

    def __init__(self, schemas: CompetingSchemas, timeline: Timeline) -> None:
        schemas.check()
        self.schemas, self.timeline = schemas, timeline
        self.cues = np.asfortranarray(schemas.arrays("cue"))  # as distances are taken
        self._targets = schemas.arrays("target")
        # All schemas, each confident near its own cues alone, and whose they are.
        node = schemas.blocks.live("node")
        reach = -math.log(1 - schemas.config.recognition.novel_above)
        numbers = torch.arange(len(node), device=node.device)
        self._everywhere = NodeSchemas(schemas, numbers, timeline, reach)
        self._node_of = node.numpy(force=True)
        self._nodes: dict[int, NodeSchemas | None] = {}  # those that have won
        self.reset()

    def reset(self) -> None:
        """Starts a new episode."""
        self.belief = Belief(self.timeline, self.schemas.config.recognition)
        self.incumbent = NO_NODE  # schema that won the competition last

    def distances(self, percept: NDArray[np.floating]) -> NDArray[np.floating]:
        """Of a percept, scaled, `[D]`, from every cue of the pool, `[R]`."""
        from pacnet.kernels.distances import distances_of  # which brings numba

        return distances_of(percept, self.cues)

    def recall(self, node: int, percept: NDArray[np.floating]) -> RecalledRow | None:
        """See `CompetingSchemas.recall`."""
        distances = self.distances(percept)
        self.belief.update(distances)
        rows = self._compete(node, distances)
        if rows is None:
            return None
        nearest = distances[rows].argsort(kind="stable")[: self.schemas.config.nearest_cues]
        chosen = self._targets[rows][nearest]
        target = chosen.sum(axis=0) / chosen.dtype.type(len(nearest))
        return RecalledRow(target, int(nearest[0]), self.incumbent)

    def rivals(self, node: int, percept: NDArray[np.floating]) -> list[Rival]:
        """See `CompetingSchemas.rivals`."""
        if node == NO_NODE:
            return []
        seen = self.distances(percept), self.belief.probability
        here, least = self._at_node(node), self.schemas.config.threshold
        own = [] if here is None else rivals_of(self.schemas, here, *seen)
        if own and own[0].confidence >= least:
            return own
        elsewhere = rivals_of(self.schemas, self._everywhere, *seen)
        others = [each for each in elsewhere if each.node != node and each.confidence >= least]
        return [*others, *own]

    def _compete(self, node: int, distances: NDArray[np.floating]) -> slice | None:
        """Lets schemas compete, the winner's own or else all that know the percept.

        Args:
            node: the winner, or `NO_NODE`.
            distances: of the percept from every cue of the pool, `[R]`.

        Returns:
            The rows of the pool of the schema that wins, the incumbent from now on; None without.
        """
        if node == NO_NODE:
            return None
        for here in self._in_turn(node):
            confidences = here.confidences(distances, self.belief.probability)
            winner = self.schemas.competition.winner(confidences, here.place_of(self.incumbent))
            if winner != NO_NODE:
                self.incumbent = here.numbers[winner]
                return here.rows_of(winner)
        self.incumbent = NO_NODE
        return None

    def _in_turn(self, node: int) -> Iterator[NodeSchemas]:
        """The schemas of a node, and those that compete where none of these wins."""
        here = self._at_node(node)
        if here is not None:
            yield here
        yield self._everywhere

    def _at_node(self, node: int) -> NodeSchemas | None:
        """The schemas of a node, picked out when it first wins; None if it has none."""
        if node not in self._nodes:
            places = np.flatnonzero(self._node_of == node)
            self._nodes[node] = self._everywhere.part(places) if len(places) > 0 else None
        return self._nodes[node]
