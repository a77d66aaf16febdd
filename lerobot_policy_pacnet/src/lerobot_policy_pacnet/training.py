"""Learning from shuffled batches with the same result as from the dataset in its own order.

The network learns whole demonstrations, frame by frame, in one pass. So the frames of LeRobot's
shuffled batches are only collected. From time to time the imitator from before this dataset learns
all frames collected so far, in order; after one pass that is the whole dataset.
"""

from __future__ import annotations

import copy
import json
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from torch import Tensor

from lerobot_policy_pacnet.configuration_pacnet import PACNetConfig
from lerobot_policy_pacnet.description import DatasetDescription
from lerobot_policy_pacnet.frames import Frames, content_of
from lerobot_policy_pacnet.parts import BASE, IMITATOR, STATE, check_subfolder, read_tensors_part
from lerobot_policy_pacnet.pictures import DatasetPictures
from lerobot_policy_pacnet.settings import (
    body_kept_by,
    body_of,
    check_points,
    check_settings,
    points_of,
)
from pacnet.core.durable import write_atomically
from pacnet.core.parts import REMEDY
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.imitator import Imitator

ENOUGH = 256  # frames to collect before learning begins, unless the dataset has fewer


class Training:
    """The training on one dataset.

    Args:
        config: of the policy.
        dataset: to learn.
        base: the imitator from before this dataset, or None.
        known: digests of demonstrations already learned; they are not learned again.
        learned: the imitator that has learned a part of this dataset, whose training goes on, or
            None; its body is kept.

    Attributes:
        imitator: what has been learned so far, or None.
        pictures: what cameras show of the dataset; None without any.
        is_finished: whether the whole dataset was learned; its frames are dropped then.

    Raises:
        FileNotFoundError: the config names a body that is not there.
        ValueError: the dataset has other features or another rate than `base`, the config has other
            settings, or the dataset no angles of the body's joints.
    """

    def __init__(
        self,
        config: PACNetConfig,
        dataset: DatasetDescription,
        base: Imitator | None = None,
        known: frozenset[str] = frozenset(),
        learned: Imitator | None = None,
    ) -> None:
        self.config, self.dataset = config, dataset
        self.base, self.known = base, known
        self.imitator = learned or base
        self.is_finished = False
        self.pictures: DatasetPictures | None = None
        self.frames = Frames(dataset.frames, dataset.percept_dimensions, dataset.action_dimensions)
        self._learned = self._tried = 0  # numbers of frames
        if self.imitator is not None:
            check_settings(config, self.imitator)
        self._body = body_of(config) if self.imitator is None else body_kept_by(self.imitator)
        if base is None:  # until all frames are there, learning may fail
            check_points(config, self._body, dataset)
        else:
            base.fork().learn(self._demonstrations(()))  # checks its features

    def __str__(self) -> str:
        """Return how much was learned, for the log."""
        source, total = self.dataset.source, self.dataset.frames
        if self.is_finished:
            return f"what was learned from all {total} frames of {source}"
        return f"what was learned from {self._learned} of the {total} frames of {source}"

    def find_pictures(self, root: str | Path) -> None:
        """Find the files of what cameras show, unless all is learned.

        Args:
            root: the dataset's folder.

        Raises:
            DatasetError: the dataset cannot be read, or lacks a camera.
        """
        named, cameras = self.config.cameras is not None, self.config.camera_features
        if self.base is not None:
            named = True
            cameras = () if self.base.cameras is None else self.base.cameras.features
        if cameras and not self.is_finished:
            self.pictures = DatasetPictures(root, cameras, named)

    def add(
        self,
        index: Tensor,
        episode: Tensor,
        percepts: Tensor,
        actions: Tensor,
        tasks: list[str],
    ) -> None:
        """Add a batch of frames; learn whenever their number has doubled.

        Arguments and errors are those of `Frames.add`. Once the dataset is learned, further frames
        change nothing.
        """
        if self.is_finished:
            return
        self.frames.add(index, episode, percepts, actions, tasks)
        if self.frames.is_complete:
            self.consolidate()
        elif self._learns_early and len(self.frames) >= max(ENOUGH, 2 * self._tried):
            with suppress(ValueError):  # more frames may be enough
                self.consolidate()

    @property
    def _state_features(self) -> tuple[str, ...]:
        """The features that are the robot's state: what the base has learned comes first."""
        return self.dataset.state_features if self.base is None else self.base.config.state_features

    @property
    def _state_dimensions(self) -> int:
        return sum(len(self.dataset.names.get(name, ())) for name in self._state_features)

    @property
    def _learns_from_parts(self) -> bool:
        """Whether frames can be learned before their neighbours were added."""
        return self.config.targets == "action"

    @property
    def _learns_early(self) -> bool:
        """Whether a part of the frames is learned unasked; cameras are fitted to all."""
        return self._learns_from_parts and self.pictures is None

    def consolidate(self) -> None:
        """Let a copy of the base learn all frames added so far, in order; it becomes the imitator.

        With states as targets this waits for the last frame: before it, the state that follows an
        action may be missing.

        Raises:
            DatasetError: the pictures cannot be read; the imitator has not changed.
            ValueError: these frames cannot be learned; the imitator has not changed.
        """
        count = len(self.frames)
        if self.is_finished or count == self._learned:
            return
        if not (self._learns_from_parts or self.frames.is_complete):
            return
        self._tried = count
        shown = self.frames.episodes(self._state_dimensions, self.pictures)
        new = self._demonstrations([one for one in shown if content_of(one) not in self.known])
        if self.base is None:
            targets = cast(Any, self.config.targets)
            imitator = Imitator.from_demonstrations(
                new,
                targets,
                self.config.lead,
                points=points_of(self.config),
                body=self._body,
                encoder=self.config.encoder,
            )
        else:
            imitator = copy.deepcopy(self.base)
        imitator.learn(new)
        self.imitator, self._learned = imitator, count
        if self.frames.is_complete:
            self.known = self.contents()
            self.base, self.is_finished, self.pictures = None, True, None
            self.frames = Frames(0, 0, 0)

    @property
    def keeps_body(self) -> bool:
        """Whether the body that was named is in the imitator, so that it is not needed again."""
        return self.imitator is not None and body_kept_by(self.imitator) is not None

    def contents(self) -> frozenset[str]:
        """Return digests of all demonstrations that the imitator knows."""
        shown = self.frames.episodes(self._state_dimensions)
        return self.known | {content_of(one) for one in shown}

    def save(self, folder: Path) -> list[str]:
        """Write the imitator to a folder of its own, and all that is needed to continue.

        Args:
            folder: of the checkpoint; it exists.

        Returns:
            The names of the files and folders written.
        """
        from safetensors.torch import save

        if self.imitator is not None:
            self.imitator.save_pretrained(folder / IMITATOR)
        if self.base is not None:
            self.base.save_pretrained(folder / BASE)
        tensors, tasks = self.frames.tensors()
        facts = {
            "dataset": asdict(self.dataset),
            "finished": self.is_finished,
            "has_base": self.base is not None,
            "known": sorted(self.known),
            "learned": self._learned,
            "tasks": tasks,
        }
        contiguous = {name: tensor.contiguous() for name, tensor in tensors.items()}
        write_atomically(folder / STATE, save(contiguous, {"training": json.dumps(facts)}))
        imitators = {IMITATOR: self.imitator, BASE: self.base}
        return [STATE, *(name for name, part in imitators.items() if part is not None)]

    @classmethod
    def load(cls, config: PACNetConfig, folder: Path) -> Training | None:
        """Return what `save` wrote; None if there is nothing.

        Raises:
            FileNotFoundError: a part is missing.
            ValueError: a damaged file, or other settings than those it was learned with.
        """
        if not (folder / STATE).exists():
            return None
        tensors, entries = read_tensors_part(folder, STATE)
        try:
            facts = json.loads(entries["training"])
            for name, belongs in _imitators(facts).items():
                if belongs:
                    check_subfolder(folder, name)
            training = cls._restored(config, folder, facts, tensors)
        except (KeyError, TypeError, IndexError, RuntimeError) as error:
            raise ValueError(
                f"expected a whole training in '{folder / STATE}', got another: {error!r}: {REMEDY}"
            ) from error
        return training

    @classmethod
    def _restored(
        cls, config: PACNetConfig, folder: Path, facts: Any, tensors: dict[str, Tensor]
    ) -> Training:
        base = Imitator.from_pretrained(folder / BASE) if facts["has_base"] else None
        dataset, known = DatasetDescription(**facts["dataset"]), frozenset(facts["known"])
        has_learned = _imitators(facts)[IMITATOR]
        learned = Imitator.from_pretrained(folder / IMITATOR) if has_learned else None
        training = cls(config, dataset, base, known, learned)
        if facts["finished"]:
            training.is_finished, training.frames = True, Frames(0, 0, 0)
        else:
            training.frames.restore(tensors, facts["tasks"])
        training._learned = training._tried = facts["learned"]
        return training

    def _demonstrations(self, episodes: Any) -> Demonstrations:
        dataset = self.dataset
        return Demonstrations(
            dataset.fps, dataset.names, tuple(episodes), dataset.source, state=self._state_features
        )


def _imitators(facts: Any) -> dict[str, bool]:
    """Return which imitators belong to a training."""
    has_learned = bool(facts["has_base"] or facts["learned"] or facts["finished"])
    return {IMITATOR: has_learned, BASE: bool(facts["has_base"])}
