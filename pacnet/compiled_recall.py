"""The compiled engine of schemas that compete: hands their arrays over to the kernels.

Imported only where it runs, for it brings numba.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet import recall_kernels as kernels
from pacnet.belief import Belief, RecognitionConfig, Timeline
from pacnet.competing_recall import CompetingRecall
from pacnet.distances import ROWS
from pacnet.node_schemas import NodeSchemas
from pacnet.sequences import RecalledRow, RecalledTarget

if TYPE_CHECKING:
    from pacnet.competing_schemas import CompetingSchemas


def distances_of(percept: NDArray[np.float32], cues: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of a percept `[D]` from cues `[R, D]`, `[R]`."""
    distances = np.empty((len(cues) + ROWS - 1) // ROWS * ROWS, np.float32)
    # As the kernel reads them, whatever they are a part of.
    percept, cues = (np.ascontiguousarray(rows, np.float32) for rows in (percept, cues))
    kernels.measure(percept, cues, distances)
    return distances[: len(cues)]


class CompiledBelief(Belief):
    """See `Belief`; of distances in float32 on the CPU."""

    def __init__(self, timeline: Timeline, config: RecognitionConfig) -> None:
        super().__init__(timeline, config)
        self._rows, self._start = timeline.rows.numpy(), timeline.start.numpy()
        self._advance = timeline.advance.numpy()

    def update(self, distances: Tensor) -> None:
        """See `Belief.update`."""
        self.follow(distances.numpy())

    def follow(self, distances: NDArray[np.float32]) -> NDArray[np.float64]:
        """`update`; hands back the probability of every place of every known episode, `[E, P]`."""
        before, restart = self._start, 0.0
        if self.has_begun:
            before, restart = self.ahead().numpy(), self.config.restart
        probability = np.empty(before.shape)
        kernels.weigh(
            before, self._start, restart, self._rows, distances,
            self.config.width, self.config.mismatch, probability,
        )  # fmt: skip
        self._begin(torch.from_numpy(probability))
        return probability

    def _move_on(self) -> Tensor:
        ahead = np.empty(self._start.shape)
        kernels.move_on(self.probability.numpy(), self._advance, ahead)
        return torch.from_numpy(ahead)


class CompiledNode(NodeSchemas):
    """See `NodeSchemas`; of float32 on the CPU."""

    @cached_property
    def _spans(self) -> NDArray[np.int64]:
        """The first row of each schema and the one behind its last, `[K, 2]`."""
        return np.array([(rows.start, rows.stop) for rows in self._blocks])

    @cached_property
    def _passes(self) -> NDArray[np.int64]:
        """The first and the last place of each pass, and the schema that it passes, `[N, 3]`."""
        return torch.stack([self._first, self._last, self._through], dim=1).numpy()

    def confidences(self, distances: Tensor, probability: Tensor) -> Tensor:
        """See `NodeSchemas.confidences`."""
        return torch.from_numpy(self.compete(distances.numpy(), probability.numpy()))

    def compete(
        self, distances: NDArray[np.float32], probability: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """`confidences` of arrays."""
        confidences = np.empty(len(self.numbers), np.float32)
        kernels.compete(
            probability.ravel(), self._passes, distances, self._spans, self._reach, confidences
        )
        return confidences


class CompiledRecall(CompetingRecall):
    """See `CompetingRecall`; of float32 on the CPU.

    Args:
        schemas: that compete, the pool without gaps.
        timeline: of the episodes that they know.
    """

    belief: CompiledBelief

    def __init__(self, schemas: CompetingSchemas, timeline: Timeline) -> None:
        super().__init__(schemas, timeline)
        self._cues = schemas.pool.live("cue").numpy()
        self._targets = schemas.pool.live("target").numpy()

    def distances(self, percept: Tensor) -> Tensor:
        """See `CompetingRecall.distances`."""
        return torch.from_numpy(distances_of(percept.detach().numpy(), self._cues))

    def recall(self, node: int, percept: Tensor) -> RecalledTarget | None:
        """See `CompetingRecall.recall`."""
        recalled = self.recall_row(node, percept.detach().numpy())
        if recalled is None:
            return None
        target, position, schema = recalled
        return RecalledTarget(torch.from_numpy(target), position, schema)

    def recall_row(self, node: int, percept: NDArray[np.float32]) -> RecalledRow | None:
        """See `CompetingRecall.recall_row`."""
        distances = distances_of(percept, self._cues)
        self._probability = self.belief.follow(distances)
        rows = self.compete(node, distances)
        if rows is None:
            return None
        nearest = distances[rows].argsort(kind="stable")[: self.schemas.config.nearest_cues]
        target = self._targets[rows][nearest].sum(axis=0) / np.float32(len(nearest))
        return RecalledRow(target, int(nearest[0]), self.incumbent)

    def _confidences(
        self, here: NodeSchemas, distances: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        assert isinstance(here, CompiledNode)
        return here.compete(distances, self._probability)

    def _new_belief(self) -> CompiledBelief:
        return CompiledBelief(self.timeline, self.schemas.config.recognition)

    def _lay_out(self, numbers: Tensor, reach: float = math.inf) -> CompiledNode:
        return CompiledNode(self.schemas, numbers, self.timeline, reach)
