"""What an imitator acts on: all that it had learned at one moment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.core.drafts import snapshot_of
from pacnet.core.growable_rows import as_array
from pacnet.imitator.novelty import NoveltyDetector
from pacnet.network.snapshot import Snapshot


class ImitatorSnapshot(NamedTuple):
    """What `Imitator.step` works on while another thread may learn."""

    network: Snapshot
    detector: NoveltyDetector
    cues: NDArray[np.float32]  # [R, D], all percepts that targets are stored with, scaled
    scale: NDArray[np.float32]  # [D], of percepts

    @classmethod
    def take(cls, network: Snapshot, detector: NoveltyDetector) -> ImitatorSnapshot:
        """Return a snapshot of a network and a detector; no thread may be changing them."""
        schemas = network.schemas
        assert isinstance(schemas, CompetingSchemas)  # of every imitator
        recall = schemas.recall_in_progress
        cues = schemas.arrays("cue") if recall is None else recall.cues
        return cls(network, snapshot_of(detector), cues, as_array(network.sofm.scale))

    def is_of(self, network: Snapshot, detector: NoveltyDetector) -> bool:
        """Whether these have not changed since."""
        typical = detector.typical_deviation
        return self.network is network and self.detector.typical_deviation is typical
