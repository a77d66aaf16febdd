"""pacnet as a LeRobot policy, for LeRobot's commands to train, save, load and run.

The network is not a submodule: it learns by its own rule, on the CPU, and is saved to a folder of
its own. LeRobot's optimizer and `model.safetensors` only see one parameter without effect.
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
from lerobot_policy_pacnet.batches import percepts_of, rows_of, tasks_of
from lerobot_policy_pacnet.configuration_pacnet import PACNetConfig
from lerobot_policy_pacnet.description import DatasetDescription
from lerobot_policy_pacnet.parts import check_policy, record_parts
from lerobot_policy_pacnet.pictures import pictures_of
from lerobot_policy_pacnet.telling import novelty_of, tell_cameras
from lerobot_policy_pacnet.training import Training
from pacnet.datasets.format import DatasetError
from pacnet.imitator.imitator import Imitator, full_precision
from pacnet.imitator.records import ImitatorStep

_DOWNLOAD = ("revision", "cache_dir", "force_download", "local_files_only", "token")
logger = logging.getLogger(__name__)


class PACNetPolicy(PreTrainedPolicy):
    """Learns demonstrations in one pass, and acts only on percepts like theirs.

    Args:
        config: see `PACNetConfig`.
        dataset_stats: statistics of the dataset; not used.
        dataset_meta: LeRobot's metadata of the dataset to learn; None to act only. With cameras
            the pictures of its episodes are read from its folder once their frames were added.

    Attributes:
        ask: called with the step and the percept `[D]` where the imitator gives no action; returns
            an action `[U]`, or None to hold. If it is None, the policy always holds.
        last_steps: the imitator's step for each row of the last batch.

    Raises:
        ValueError: features of percepts or actions that are not vectors.
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
        self._is_current = False  # whether `_training` is on the dataset of the metadata
        self._batch_size = 1  # the largest so far
        self._actors: list[Actor] = []

    @property
    def imitator(self) -> Imitator | None:
        """What has been learned so far; None if nothing."""
        return None if self._training is None else self._training.imitator

    def forward(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        """Return how novel a batch of frames is; in training mode add it to the training.

        Args:
            batch: frames of a dataset in any order.

        Returns:
            The mean novelty of the percepts as the loss, from 0 to 1 (unlike all that is known),
            and the number of nodes, for the log.

        Raises:
            ValueError: several processes; no metadata; frames of another dataset; other features or
                another rate than learned before; or values that are not finite.
        """
        percepts = percepts_of(batch, self.config.percept_features)
        novelty = 1.0
        with torch.no_grad(), full_precision():
            if self.training:
                self._learn(batch, percepts)
            imitator = self.imitator
            if imitator is not None:
                novelty = novelty_of(imitator, percepts)
        nodes = 0 if imitator is None else len(imitator.sofm)
        return novelty + 0 * self.anchor.sum(), {"nodes": float(nodes)}

    def train(self, mode: bool = True) -> PACNetPolicy:
        """Set the mode; before evaluation, learn all frames added so far."""
        if not mode:
            self._consolidate()
        super().train(mode)
        return self

    def reset(self) -> None:
        """Start a new recall episode; what was learned stays."""
        self.last_steps = []
        imitator = self.imitator
        if imitator is None:
            return
        if not all(actor.is_of(imitator) for actor in self._actors):
            self._actors = []
        for actor in self._actors_for(len(self._actors) or 1):  # compiled before a robot moves
            actor.reset()

    @torch.no_grad()
    def select_action(self, batch: dict[str, Any], **_: Any) -> Tensor:
        """Return the action for each row of a batch, going on from the last call.

        Args:
            batch: observations, B rows, with pictures of the cameras that are used while the
                imitator looks; each row has a recall episode of its own. A `task`, a text or one
                for each row, restricts what is followed to what was shown for it.

        Returns:
            Actions `[B, U]`.

        Raises:
            ValueError: nothing was learned; a feature or a picture is missing, misshapen or not
                finite; a task that was not shown.
        """
        percepts = percepts_of(batch, self.config.percept_features).numpy()
        tasks = tasks_of(batch, len(percepts), self.config.task)
        actors = self._actors_for(len(percepts))
        cameras = actors[0].imitator.cameras
        features = () if cameras is None else cameras.features
        # Tensors made in a caller's inference mode could not be changed outside it.
        with torch.inference_mode(False):
            for actor, task in zip(actors, tasks, strict=True):
                actor.pursue(task)
            looking = [actor.imitator.is_looking for actor in actors]
            pictures = pictures_of(batch, features, looking)
            acted = [
                actor.act(row, self.ask, seen)
                for actor, row, seen in zip(actors, percepts, pictures, strict=True)
            ]
        self.last_steps = [step for _, step in acted]
        return torch.from_numpy(np.stack([action for action, _ in acted])).to(self.anchor.device)

    def predict_action_chunk(self, batch: dict[str, Any], **_: Any) -> Tensor:
        """Return the same as chunks of one action, `[B, 1, U]`."""
        return self.select_action(batch)[:, None]

    def get_optim_params(self) -> Any:
        """Return the one parameter, which has no effect."""
        return [self.anchor]

    @classmethod
    def from_pretrained(cls, pretrained_name_or_path: str | Path, **kwargs: Any) -> PACNetPolicy:
        """Load what `save_pretrained` wrote, to act or to learn more.

        Args:
            pretrained_name_or_path: folder, or the name of a repository on the Hub.
            kwargs: as of LeRobot's policies.

        Raises:
            FileNotFoundError: a part of the folder is missing.
            ValueError: a part is damaged, or a Git LFS pointer.
        """
        folder = Path(pretrained_name_or_path)
        if not folder.is_dir():
            options = {name: kwargs[name] for name in _DOWNLOAD if name in kwargs}
            folder = Path(snapshot_download(str(pretrained_name_or_path), **options))
        check_policy(folder, needs_config=kwargs.get("config") is None)
        policy = super().from_pretrained(folder, **kwargs)
        policy._training = Training.load(policy.config, folder)
        return policy

    def _save_pretrained(self, save_directory: Path, **kwargs: Any) -> None:
        self._consolidate()
        if self._training is not None and self._training.keeps_body:
            self.config.body = None  # its folder is not needed again
        super()._save_pretrained(save_directory, **kwargs)
        if self._training is not None:
            record_parts(Path(save_directory), self._training.save(Path(save_directory)))
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
        actions = rows_of(batch, ACTION, training.dataset.action_dimensions)
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
                "%s: further steps change nothing; the result is saved with the next checkpoint; "
                "one pass is --steps=%d",
                training, -(-training.dataset.frames // self._batch_size),
            )  # fmt: skip
            tell_cameras(training.imitator)

    def _training_of(self, meta: Any) -> Training:
        """Return the current training; begin a new one if the dataset has changed."""
        if meta is None:
            raise ValueError(
                "expected dataset_meta to learn with, as lerobot-train passes it, got none"
            )
        if self._training is not None and self._is_current:
            return self._training
        dataset = DatasetDescription.of(meta, self.config.percept_features)
        before = self._training
        if before is None:
            self._training = Training(self.config, dataset)
        elif before.dataset.fingerprint != dataset.fingerprint:
            self._training = Training(self.config, dataset, before.imitator, before.contents())
        assert self._training is not None
        self._training.find_pictures(meta.root)
        self._is_current = True
        return self._training

    def _consolidate(self) -> None:
        training = self._training
        if training is None:
            return
        try:
            training.consolidate()
        except DatasetError:
            raise  # pictures that cannot be read
        except ValueError as error:
            logger.warning("nothing can be learned from %d frames: %s", len(training.frames), error)

    def _actors_for(self, rows: int) -> list[Actor]:
        imitator = self.imitator
        if imitator is None:
            raise ValueError("expected a trained policy to act, got one that has learned nothing")
        if len(self._actors) != rows:
            with torch.inference_mode(False):
                self._actors = [Actor(imitator) for _ in range(rows)]
        return self._actors


def _check_alone() -> None:
    distributed = torch.distributed
    alone = not (distributed.is_available() and distributed.is_initialized())
    if not alone and distributed.get_world_size() > 1:
        raise ValueError(
            f"expected one process, got {distributed.get_world_size()}: each would get a part of "
            "the frames, and one process learns them all in seconds"
        )
