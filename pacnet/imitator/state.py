"""The state of an imitator: learning replaces it all at once, while other threads read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.core.checkpoint import load_checkpoint, save_checkpoint
from pacnet.core.drafts import snapshot_of
from pacnet.core.growable_rows import as_array, copy_on_state_dict
from pacnet.core.integrity import (
    check_conditions,
    check_model,
    check_on_load,
    check_structure,
    part_of,
)
from pacnet.core.old_names import old_names, rename_on_load
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.novelty import NoveltyDetector
from pacnet.imitator.records import EpisodeReport, read_reports
from pacnet.kernels.engine import Engine
from pacnet.network.checks import FORWARD_MODEL, check_dimensions
from pacnet.network.network import PACNet
from pacnet.network.snapshot import Snapshot
from pacnet.schemas.sequences import OLD_TENSORS

_MODEL = "network." + FORWARD_MODEL
_OLD_TENSORS = OLD_TENSORS | {"familiarity": "novelty_detector", "usual": "typical_deviation"}


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
        """Return whether these have not changed since."""
        typical = detector.typical_deviation
        return self.network is network and self.detector.typical_deviation is typical


@old_names(lessons="reports", familiarity="novelty_detector")
class ImitatorState(nn.Module):
    """The parts of an `Imitator`, which may `step` in one thread while another learns.

    Args:
        config: see `ImitatorConfig`.
        engine: as of `PACNet`.
    """

    first_action: Tensor  # [U], mean over the demonstrations, see `Imitator.learn`

    def __init__(self, config: ImitatorConfig, engine: Engine = "auto") -> None:
        super().__init__()
        self.config = config
        model = None if config.forward_model is None else MLPForwardModel(config.forward_model)
        self.network = PACNet(config.network, model, engine)
        self.novelty_detector = NoveltyDetector(config.network.attention.dimensions)
        self.reports: list[EpisodeReport] = []
        self.register_buffer("first_action", torch.zeros(len(config.action)))
        self._snapshot: ImitatorSnapshot | None = None
        copy_on_state_dict(self)
        rename_on_load(self, _OLD_TENSORS)
        check_on_load(self)

    def extra_repr(self) -> str:
        """Return the number of demonstrations learned and the dimensions, for `print`."""
        percepts, actions = len(self.percept_names), len(self.config.action)
        lengths = f"percept_dimensions={percepts}, action_dimensions={actions}"
        return f"demonstrations={len(self.reports)}, {lengths}, fps={self.config.fps}"

    @property
    def percept_names(self) -> tuple[str, ...]:
        """Names of a percept's D dimensions."""
        return self.config.percept_names

    @property
    def schemas(self) -> CompetingSchemas:
        """The network's motor schemas."""
        schemas = self.network.schemas
        assert isinstance(schemas, CompetingSchemas)
        return schemas

    @property
    def forward_model(self) -> MLPForwardModel | None:
        """The model that finds the action leading to a state; None where targets are actions."""
        model = self.network.forward_model
        assert model is None or isinstance(model, MLPForwardModel)
        return model

    def _latest(self) -> ImitatorSnapshot:
        """Return a snapshot of what is known now; the same one until something is learned."""
        network, snapshot = self.network.snapshot(), self._snapshot
        if snapshot is None or not snapshot.is_of(network, self.novelty_detector):
            with self.network.state_lock:
                snapshot = ImitatorSnapshot.take(self.network.snapshot(), self.novelty_detector)
                self._snapshot = snapshot
        return snapshot

    def __getstate__(self) -> dict[str, Any]:
        """Leave the snapshot out of copies, which take their own."""
        return {**self.__dict__, "_snapshot": None}

    # Checkpoints

    def save_pretrained(self, folder: str | Path) -> None:
        """Write `config.json` and `model.safetensors`, atomically.

        After a crash the old or the new checkpoint is intact.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: tensors that contradict one another; nothing has been written.
        """
        with self.network.state_lock:
            tensors, reports = self.state_dict(), [report._asdict() for report in self.reports]
        self.check_state(tensors)
        fields = {
            **asdict(self.config),
            "network": self.config.network.to_dict(),
            "reports": reports,
        }
        save_checkpoint(folder, "Imitator", fields, tensors)

    @classmethod
    def from_pretrained(cls, folder: str | Path, engine: Engine = "auto") -> Self:
        """Load what `save_pretrained` wrote, on the CPU, ready to act or to learn more.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of something else, or a
                missing, extra or misshapen tensor.
        """
        fields, tensors = load_checkpoint(folder, "Imitator")
        old_reports = fields.pop("lessons", None)  # their name in checkpoints of version 0.1
        reports = read_reports(fields.pop("reports", old_reports))
        config = ImitatorConfig.from_dict(fields)
        try:
            check_dimensions(config.network, tensors, "network.")  # before memory is allocated
            if config.forward_model is not None:
                MLPForwardModel.check_sizes(config.forward_model, part_of(tensors, _MODEL))
            imitator = cls(config, engine)
            imitator.load_state_dict(tensors)
            imitator.reports = reports
            imitator._check_reports()
        except (RuntimeError, ValueError) as error:
            reason = " ".join(str(error).split())  # torch's messages have several lines
            raise ValueError(
                f"expected the tensors of an Imitator in '{folder}': {reason}"
            ) from error
        return imitator

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """Return the state; where another thread learns, that of before or after it."""
        with self.network.state_lock:
            return super().state_dict(*args, **kwargs)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Load a state, all or nothing, once other threads have finished learning."""
        with self.network.learning_lock, self.network.state_lock:
            check_model(self.forward_model, part_of(state_dict, _MODEL), strict)
            return super().load_state_dict(state_dict, strict, assign)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        check_conditions({"a finite first action": tensors["first_action"].isfinite().all()})

    def _check_reports(self) -> None:
        """Raise a ValueError unless each episode that the network learned has a report."""
        self.schemas.episodes.check()
        numbers = self.schemas.episodes.live("number")
        if len(numbers) and int(numbers[-1]) >= len(self.reports):
            raise ValueError(
                f"expected a report of each of {int(numbers[-1]) + 1} episodes learned, "
                f"got {len(self.reports)}"
            )
