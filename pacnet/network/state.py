"""The state of a network: learning replaces it all at once, while other threads read it."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor, nn

from pacnet.attention.sofm import HabituatingSOFM
from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.core.checkpoint import load_checkpoint, save_checkpoint
from pacnet.core.drafts import Lock, adopt, draft_of, short_switch_interval
from pacnet.core.growable_rows import check_storage, copy_on_state_dict
from pacnet.core.integrity import (
    check_conditions,
    check_model,
    check_on_load,
    check_structure,
    part_of,
)
from pacnet.core.old_names import rename_on_load
from pacnet.forward_models.protocol import ForwardModel
from pacnet.kernels.engine import Engine
from pacnet.network.checks import FORWARD_MODEL, check_dimensions, check_model_type
from pacnet.network.config import PACNetConfig
from pacnet.network.snapshot import Snapshot
from pacnet.schemas.forgetting import load_without
from pacnet.schemas.interface import NO_EPISODE, Schemas
from pacnet.schemas.motor_schemas import MotorSchemas
from pacnet.schemas.sequences import OLD_TENSORS


class NetworkState(nn.Module):
    """The parts of a `PACNet`, which other threads read while one learns.

    Learning changes a draft, which then replaces the state. Recall works on a snapshot.

    Args:
        config: see `PACNetConfig`.
        forward_model: as of `PACNet`.
        engine: as of `PACNet`.
    """

    episode: Tensor

    def __init__(
        self,
        config: PACNetConfig,
        forward_model: ForwardModel | None = None,
        engine: Engine = "auto",
    ) -> None:
        super().__init__()
        check_model_type(forward_model)
        self.config = config
        self.forward_model = forward_model
        self.sofm = HabituatingSOFM(config.attention, engine)
        self.schemas: Schemas = (
            CompetingSchemas(config.schemas)
            if isinstance(config.schemas, CompetingSchemasConfig)
            else MotorSchemas(config.schemas)
        )
        # One thread learns at a time. The state itself is locked only while it is replaced or read.
        self.learning_lock, self.state_lock = Lock(), Lock()
        self._snapshot: Snapshot | None = None  # of the recall episode in progress
        self.register_buffer("episode", torch.tensor(NO_EPISODE))  # the last one observed
        copy_on_state_dict(self)
        rename_on_load(self, OLD_TENSORS)
        load_without(self)
        check_on_load(self)

    def extra_repr(self) -> str:
        """Return the lengths of percepts and targets, for `print`."""
        percepts, targets = self.config.attention.dimensions, self.config.schemas.target_dimensions
        return f"percept_dimensions={percepts}, target_dimensions={targets}"

    @property
    def behaviours(self) -> tuple[str, ...]:
        """Names of the demonstrated behaviours, in order of first use, where they are kept."""
        return tuple(self.schemas.behaviours)

    @contextmanager
    def learning(self) -> Iterator[Self]:
        """Yield a draft of this network to learn on, for `adopt`; other learners wait."""
        # Growing inside a caller's inference mode would make buffers that cannot be updated later.
        with self.learning_lock, short_switch_interval(), torch.inference_mode(False):
            with self.state_lock:  # a reader may be compacting the schemas
                draft = copy.copy(self)  # which shares the forward model
                parts = {"sofm": draft_of(self.sofm), "schemas": draft_of(self.schemas)}
                draft._modules = {**self._modules, **parts}
                draft._buffers = {"episode": check_storage("episode", self.episode).clone()}
            yield draft

    def adopt(self, draft: Self) -> None:
        """Replace the state by that of a draft; `state_lock` must be held."""
        snapshot = None if self._snapshot is None else Snapshot(draft.sofm, draft.schemas)
        adopt(self.sofm, draft.sofm)
        adopt(self.schemas, draft.schemas)
        self._buffers["episode"] = draft.episode
        if snapshot is not None:
            snapshot.track(self.sofm, self.schemas)
        self._snapshot = snapshot

    def snapshot(self) -> Snapshot:
        """Return the snapshot that the recall episode works on; a new one after learning."""
        snapshot, parts = self._snapshot, self._modules  # as attributes they take a microsecond
        if snapshot is None or not snapshot.is_of(parts["sofm"], parts["schemas"]):
            with self.state_lock:
                snapshot = self._snapshot
                if snapshot is None or not snapshot.is_of(self.sofm, self.schemas):
                    self._snapshot = snapshot = Snapshot(self.sofm, self.schemas)
        return snapshot

    # Checkpoints

    def save_pretrained(self, folder: str | Path) -> None:
        """Write `config.json` and `model.safetensors`, atomically.

        After a crash the old or the new checkpoint is intact.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: the network's tensors contradict one another; nothing has been written.
        """
        tensors = self.state_dict()
        own = {name: t for name, t in tensors.items() if not name.startswith(FORWARD_MODEL)}
        self.check_state(own)
        save_checkpoint(folder, "PACNet", self.config.to_dict(), own)

    @classmethod
    def from_pretrained(
        cls,
        folder: str | Path,
        forward_model: ForwardModel | None = None,
        engine: Engine = "auto",
    ) -> Self:
        """Load what `save_pretrained` wrote, on the CPU, ready to recall or to continue learning.

        Args:
            folder: of the checkpoint.
            forward_model: to act with.
            engine: as of `PACNet`.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of another class, or a
                missing, extra or misshapen tensor.
        """
        fields, tensors = load_checkpoint(folder, "PACNet")
        config = PACNetConfig.from_dict(fields)
        try:
            check_dimensions(config, tensors, "")  # before memory is allocated
            network = cls(config, engine=engine)
            network.to(tensors["sofm.nodes.prototype"].dtype)
            network.load_state_dict(tensors)
        except ValueError as error:
            raise ValueError(f"expected the tensors of a PACNet in '{folder}': {error}") from error
        network.forward_model = forward_model
        return network

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """Return the state; where another thread learns, that of before or after it."""
        with self.state_lock:
            return super().state_dict(*args, **kwargs)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Load a state, all or nothing, once other threads have finished learning."""
        with self.learning_lock, self.state_lock:
            check_model(self.forward_model, part_of(state_dict, FORWARD_MODEL), strict)
            return super().load_state_dict(state_dict, strict, assign)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are a valid state.

        A forward model checks its own.
        """
        check_structure(self, tensors)
        kept, last = self.schemas.extent(part_of(tensors, "schemas."))
        nodes = len(tensors["sofm.nodes.prototype"])
        if nodes != kept:
            raise ValueError(f"expected motor schemas for each node, got {kept} for {nodes} nodes")
        check_conditions(
            {"an episode ≥ −1, the last of all": tensors["episode"] >= max(NO_EPISODE, last)}
        )
