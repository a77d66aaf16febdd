"""A recall episode of schemas that compete: which of the winner's gives the target, and which one.

In torch, this is the specification; `pacnet.compiled_recall` does the same in machine code.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention import NOBODY
from pacnet.belief import Belief, Timeline
from pacnet.explanation import Rival, rivals_of
from pacnet.node_schemas import NodeSchemas
from pacnet.sequences import RecalledRow, RecalledTarget

if TYPE_CHECKING:
    from pacnet.competing_schemas import CompetingSchemas


class CompetingRecall:
    """Goes on from sample to sample, as long as nothing is learned.

    Args:
        schemas: that compete, the pool without gaps.
        timeline: of the episodes that they know.

    Attributes:
        belief: which of these is being watched, and how far it is.
    """

    def __init__(self, schemas: CompetingSchemas, timeline: Timeline) -> None:
        self.schemas, self.timeline = schemas, timeline
        self.nodes: dict[int, NodeSchemas | None] = {}  # those that have won
        self._everywhere: NodeSchemas | None = None  # all schemas
        self.reset()

    def reset(self) -> None:
        """Starts a new episode."""
        self.belief = self._new_belief()
        self.incumbent = NOBODY  # schema that won the competition last

    def distances(self, percept: Tensor) -> Tensor:
        """Of a percept, scaled, `[D]`, from every cue of the pool, `[R]`."""
        return torch.linalg.vector_norm(self.schemas.pool.live("cue") - percept.detach(), dim=1)

    def recall(self, node: int, percept: Tensor) -> RecalledTarget | None:
        """See `CompetingSchemas.recall`."""
        distances = self.distances(percept)
        self.belief.update(distances)
        rows = self.compete(node, distances)
        if rows is None:
            return None
        nearest = distances[rows].argsort(stable=True)[: self.schemas.config.nearest_cues]
        target = self.schemas.pool.live("target")[rows.start + nearest].mean(dim=0)
        return RecalledTarget(target, int(nearest[0]), self.incumbent)

    def compete(self, node: int, distances: Any) -> slice | None:
        """Lets schemas compete, the winner's own or else all that know the percept.

        Args:
            node: the winner, or `NOBODY`.
            distances: of the percept from every cue of the pool, `[R]`.

        Returns:
            The rows of the pool of the schema that wins, the incumbent from now on; None without.
        """
        if node == NOBODY:
            return None
        for here in self._in_turn(node):
            confidences = self._confidences(here, distances)
            winner = self.schemas.competition.winner(confidences, here.place_of(self.incumbent))
            if winner != NOBODY:
                self.incumbent = here.numbers[winner]
                return here.rows_of(winner)
        self.incumbent = NOBODY
        return None

    def recall_row(self, node: int, percept: NDArray[np.float32]) -> RecalledRow | None:
        """`recall` for a percept that is no tensor."""
        cues = self.schemas.pool.live("cue")
        recalled = self.recall(node, torch.from_numpy(percept).to(cues))
        if recalled is None:
            return None
        target, position, schema = recalled
        return RecalledRow(target.numpy(force=True), position, schema)

    def rivals(self, node: int, percept: Tensor) -> list[Rival]:
        """See `CompetingSchemas.rivals`."""
        if node == NOBODY:
            return []
        seen = self.distances(percept), self.belief.probability
        here, least = self.at_node(node), self.schemas.config.threshold
        own = [] if here is None else rivals_of(self.schemas, here, *seen)
        if own and own[0].confidence >= least:
            return own
        elsewhere = rivals_of(self.schemas, self.everywhere(), *seen)
        others = [each for each in elsewhere if each.node != node and each.confidence >= least]
        return [*others, *own]

    def at_node(self, node: int) -> NodeSchemas | None:
        """The schemas of a node, laid out when it first wins; None if it has none."""
        if node not in self.nodes:
            numbers = self.schemas.schemas_of(node)
            self.nodes[node] = self._lay_out(numbers) if len(numbers) > 0 else None
        return self.nodes[node]

    def everywhere(self) -> NodeSchemas:
        """The schemas of all nodes, each confident near its own cues alone."""
        if self._everywhere is None:
            recognition, count = self.schemas.config.recognition, len(self.schemas.blocks)
            numbers = torch.arange(count, device=self.timeline.rows.device)
            self._everywhere = self._lay_out(numbers, -math.log(1 - recognition.novel_above))
        return self._everywhere

    def _in_turn(self, node: int) -> Iterator[NodeSchemas]:
        """The schemas of a node, and those that compete where none of these wins."""
        here = self.at_node(node)
        if here is not None:
            yield here
        yield self.everywhere()

    def _confidences(self, here: NodeSchemas, distances: Any) -> NDArray[np.floating[Any]]:
        """Of schemas, given the distances and the belief."""
        return here.confidences(distances, self.belief.probability).numpy(force=True)

    def _new_belief(self) -> Belief:
        return Belief(self.timeline, self.schemas.config.recognition)

    def _lay_out(self, numbers: Tensor, reach: float = math.inf) -> NodeSchemas:
        return NodeSchemas(self.schemas, numbers, self.timeline, reach)
