"""pacnet as LeRobot's commands train, save, load and run policies.

The network is not a submodule: it learns by its own rule, on the CPU, and is saved in a folder of
its own. What LeRobot's optimizer and `model.safetensors` see is one parameter that does nothing.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import torch
from huggingface_hub import snapshot_download
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import ACTION
from torch import Tensor, nn

from lerobot_policy_pacnet.acting import Actor, Ask
from lerobot_policy_pacnet.configuration_pacnet import PACNetConfig
from lerobot_policy_pacnet.description import DatasetDescription
from lerobot_policy_pacnet.training import Training
from pacnet.imitator.imitator import Imitator, ImitatorStep, exactly

_DOWNLOAD = ("revision", "cache_dir", "force_download", "local_files_only", "token")
logger = logging.getLogger(__name__)


class PACNetPolicy(PreTrainedPolicy):
    """Imitates what it was shown, learns in one pass, and acts only on what it knows.

    Args:
        config: see `PACNetConfig`.
        dataset_stats: statistics of the dataset; not used.
        dataset_meta: LeRobot's metadata of the dataset to learn from; None to act only.

    Attributes:
        ask: called with the step and the percept `[D]` where the imitator does not act; returns an
            action `[U]`, or None to hold. None holds always.
        last_steps: what the imitator made of each row of the last batch, see `ImitatorStep`.

    Raises:
        ValueError: features that percepts or actions cannot be made of.
    """

    config_class = PACNetConfig  # type: ignore[assignment]  # the base class says None
    name = "pacnet"  # type: ignore[assignment]
    config: PACNetConfig

    def __init__(
        self,
        config: PACNetConfig,
        dataset_stats: dict[str, dict[str, Tensor]] | None = None,  # noqa: ARG002
        dataset_meta: Any = None,
    ) -> None:
        super().__init__(config)
        config.validate_features()
        self.ask: Ask | None = None
        self.last_steps: list[ImitatorStep] = []
        self.anchor = nn.Parameter(torch.zeros(1))
        self._dataset_meta = dataset_meta
        self._training: Training | None = None
        self._is_current = False  # whether the training is that of the metadata
        self._batch_size = 1  # the largest so far
        self._actors: list[Actor] = []

    @property
    def imitator(self) -> Imitator | None:
        """What was learned until now; None if nothing was."""
        return None if self._training is None else self._training.imitator

    def forward(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        """Keeps a batch of frames to learn from, in training mode; says how novel it is.

        Args:
            batch: frames of a dataset in any order.

        Returns:
            The mean novelty of the percepts, 1 for what is unlike all that is known, and the number
            of nodes, to log.

        Raises:
            ValueError: several processes, no metadata to learn with, another dataset than the
                metadata's, features or a rate other than learned before, or numbers that are not
                finite.
        """
        percepts = self._percepts(batch)
        novelty = 1.0
        with torch.no_grad(), exactly():
            if self.training:
                self._learn(batch, percepts)
            imitator = self.imitator
            if imitator is not None:
                novelty = float(1 - imitator.network(percepts).activation.mean())
        nodes = 0 if imitator is None else len(imitator.network.sofm)
        return novelty + 0 * self.anchor.sum(), {"nodes": float(nodes)}

    def train(self, mode: bool = True) -> PACNetPolicy:
        """Learns what came until now before it is judged."""
        if not mode:
            self._consolidate()
        super().train(mode)
        return self

    def reset(self) -> None:
        """Starts a new recall episode; what was learned stays."""
        self.last_steps = []
        imitator = self.imitator
        if imitator is None:
            return
        if not all(actor.knows(imitator) for actor in self._actors):
            self._actors = []
        for actor in self._actors_for(len(self._actors) or 1):  # ready before a robot moves
            actor.reset()

    @torch.no_grad()
    def select_action(self, batch: dict[str, Any], **_: Any) -> Tensor:
        """What to do about each row of a batch, going on from the last call.

        Args:
            batch: what is perceived, B rows; each goes through a recall episode of its own.

        Returns:
            Actions `[B, U]`.

        Raises:
            ValueError: nothing was learned, a feature is missing or misshapen, or not finite.
        """
        percepts = self._percepts(batch).numpy()
        actors = self._actors_for(len(percepts))
        # What a caller's inference mode makes could not be changed outside it.
        with torch.inference_mode(False):
            acted = [actor.act(row, self.ask) for actor, row in zip(actors, percepts, strict=True)]
        self.last_steps = [step for _, step in acted]
        return torch.from_numpy(np.stack([action for action, _ in acted])).to(self.anchor.device)

    def predict_action_chunk(self, batch: dict[str, Any], **_: Any) -> Tensor:
        """The same as chunks of one action, `[B, 1, U]`."""
        return self.select_action(batch)[:, None]

    def get_optim_params(self) -> Any:
        """The one parameter, on which nothing depends."""
        return [self.anchor]

    @classmethod
    def from_pretrained(cls, pretrained_name_or_path: str | Path, **kwargs: Any) -> PACNetPolicy:
        """Loads what `save_pretrained` wrote, to act or to go on learning.

        Args:
            pretrained_name_or_path: folder, or the name of a repository on the Hub.
            kwargs: as LeRobot's policies take them.
        """
        folder = Path(pretrained_name_or_path)
        if not folder.is_dir():
            asked = {name: kwargs[name] for name in _DOWNLOAD if name in kwargs}
            folder = Path(snapshot_download(str(pretrained_name_or_path), **asked))
        policy = super().from_pretrained(folder, **kwargs)
        policy._training = Training.load(policy.config, folder)
        return policy

    def _save_pretrained(self, save_directory: Path, **kwargs: Any) -> None:
        self._consolidate()
        super()._save_pretrained(save_directory, **kwargs)
        if self._training is not None:
            self._training.save(Path(save_directory))
            logger.info("saved %s", self._training)
            if not self._training.is_finished:
                logger.warning(
                    "this is an unfinished pass: a whole one takes %d steps, divided by the batch "
                    "size and rounded up",
                    self._training.dataset.frames,
                )

    def _learn(self, batch: dict[str, Any], percepts: Tensor) -> None:
        _check_alone()
        training = self._training_of(self._dataset_meta)
        actions = _rows(batch, ACTION, training.dataset.action_dimensions)
        index, episode = (batch[name].reshape(-1).cpu() for name in ("index", "episode_index"))
        if not len(index) == len(episode) == len(percepts) == len(actions):
            raise ValueError(
                f"expected one frame for each of {len(index)} indices, got {len(percepts)} "
                f"percepts and {len(actions)} actions"
            )
        was_finished = training.is_finished
        tasks = list(batch.get("task", [""] * len(index)))
        training.add(index, episode, percepts, actions, tasks)
        self._batch_size = max(self._batch_size, len(index))  # the last of a pass may be short
        if training.is_finished and not was_finished:
            logger.info(
                "%s: further steps change nothing, and what was learned is saved when training "
                "saves; one pass is --steps=%d",
                training, -(-training.dataset.frames // self._batch_size),
            )  # fmt: skip

    def _training_of(self, meta: Any) -> Training:
        """The training that goes on, or that begins because the dataset is another."""
        if meta is None:
            raise ValueError(
                "expected dataset_meta to learn with, as lerobot-train gives it, got none"
            )
        if self._training is not None and self._is_current:
            return self._training
        dataset = DatasetDescription.of(meta, self.config.percept_features)
        before = self._training
        if before is None:
            self._training = Training(self.config, dataset)
        elif before.dataset.fingerprint != dataset.fingerprint:
            self._training = Training(self.config, dataset, before.imitator, before.contents())
        self._is_current = True
        assert self._training is not None
        return self._training

    def _consolidate(self) -> None:
        training = self._training
        if training is None:
            return
        try:
            training.consolidate()
        except ValueError as error:
            logger.warning("nothing can be learned from %d frames: %s", len(training.frames), error)

    def _actors_for(self, rows: int) -> list[Actor]:
        imitator = self.imitator
        if imitator is None:
            raise ValueError("expected a taught policy to act, got one that has learned nothing")
        if len(self._actors) != rows:
            with torch.inference_mode(False):
                self._actors = [Actor(imitator) for _ in range(rows)]
        return self._actors

    def _percepts(self, batch: dict[str, Any]) -> Tensor:
        """Percepts `[B, D]` of a batch, float32 on the CPU."""
        features = self.config.percept_features
        rows = [_rows(batch, name, feature.shape[0]) for name, feature in features.items()]
        if len({len(row) for row in rows}) > 1:
            raise ValueError(
                f"expected as many rows of each feature, got {[len(row) for row in rows]} "
                f"of {list(features)}"
            )
        if len(rows[0]) == 0:
            raise ValueError("expected a batch of at least one row, got none")
        return torch.cat(rows, dim=1)


def _rows(batch: dict[str, Any], name: str, dimensions: int) -> Tensor:
    """A feature as `[B, D]`: LeRobot drops a dimension of 1, and adds one for a step of time."""
    if name not in batch:
        raise ValueError(f"expected {name!r} in the batch, got {', '.join(map(str, batch))}")
    value = batch[name]
    if value.numel() % dimensions or (value.dim() > 1 and value.shape[-1] != dimensions > 1):
        raise ValueError(f"expected {name!r} of shape [B, {dimensions}], got {list(value.shape)}")
    return value.detach().reshape(-1, dimensions).to("cpu", torch.float32)


def _check_alone() -> None:
    distributed = torch.distributed
    alone = not (distributed.is_available() and distributed.is_initialized())
    if not alone and distributed.get_world_size() > 1:
        raise ValueError(
            f"expected one process, got {distributed.get_world_size()}: each would see a part of "
            "the frames, and one learns them in seconds"
        )
