"""A recall episode of schemas that compete: which of the winner's gives the target, and which one.

In torch, this is the specification; `pacnet.compiled_recall` does the same in machine code.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention import NOBODY
from pacnet.belief import Belief, Timeline
from pacnet.explanation import Rival, rivals_of
from pacnet.node_schemas import NodeSchemas
from pacnet.sequences import RecalledRow, RecalledTarget

if TYPE_CHECKING:
    import numpy as np

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
        here = self.at_node(node)
        if here is None:
            return None
        confidences = here.confidences(distances, self.belief.probability)
        winner = self.schemas.competition.winner(
            confidences.numpy(force=True), here.place_of(self.incumbent)
        )
        self.incumbent = NOBODY if winner == NOBODY else here.numbers[winner]
        if winner == NOBODY:
            return None
        rows = here.rows_of(winner)
        nearest = distances[rows].argsort(stable=True)[: self.schemas.config.nearest_cues]
        target = self.schemas.pool.live("target")[rows.start + nearest].mean(dim=0)
        return RecalledTarget(target, int(nearest[0]), self.incumbent)

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
        here = self.at_node(node)
        if here is None:
            return []
        return rivals_of(self.schemas, here, self.distances(percept), self.belief.probability)

    def at_node(self, node: int) -> NodeSchemas | None:
        """The schemas of a node, laid out when it first wins; None if it has none."""
        if node not in self.nodes:
            numbers = self.schemas.schemas_of(node)
            self.nodes[node] = self._lay_out(numbers) if len(numbers) > 0 else None
        return self.nodes[node]

    def _new_belief(self) -> Belief:
        return Belief(self.timeline, self.schemas.config.recognition)

    def _lay_out(self, numbers: Tensor) -> NodeSchemas:
        return NodeSchemas(self.schemas, numbers, self.timeline)
