"""Learning a dataset whose frames come shuffled: what is learned is the dataset in its own order.

The network learns by watching demonstrations, each frame after the one before, in one pass. So a
frame out of LeRobot's shuffled batches is only kept, and now and then the imitator of before this
dataset watches all that was kept. After one pass that is the dataset, whatever the order was.
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
from pacnet.core.durable import write_atomically
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.imitator import Imitator

IMITATOR, BASE, STATE = "imitator", "base", "training.safetensors"  # in a checkpoint's folder
ENOUGH = 256  # frames before which nothing is learned, unless they are all there are


class Training:
    """The training of one dataset.

    Args:
        config: of the policy.
        dataset: that is learned.
        base: what was known before, or None.
        known: digests of the demonstrations that are known; they are not learned again.

    Attributes:
        imitator: what is known now, or None.
        is_finished: whether the whole dataset is; its frames are not kept any more then.

    Raises:
        ValueError: the dataset has other features or another rate than what was learned before,
            or the settings are others.
    """

    def __init__(
        self,
        config: PACNetConfig,
        dataset: DatasetDescription,
        base: Imitator | None = None,
        known: frozenset[str] = frozenset(),
    ) -> None:
        self.config, self.dataset = config, dataset
        self.base, self.known = base, known
        self.imitator = base
        self.is_finished = False
        self.frames = Frames(dataset.frames, dataset.percept_dimensions, dataset.action_dimensions)
        self._learned = self._tried = 0  # frames
        if base is not None:
            _check_settings(config, base)
            copy.deepcopy(base).learn(self._demonstrations(()))  # refuses other features

    def __str__(self) -> str:
        """How far it is."""
        source, all_of_them = self.dataset.source, self.dataset.frames
        if self.is_finished:
            return f"what was learned from all {all_of_them} frames of {source}"
        return f"what was learned from {self._learned} of the {all_of_them} frames of {source}"

    def add(
        self,
        index: Tensor,
        episode: Tensor,
        percepts: Tensor,
        actions: Tensor,
        tasks: list[str],
    ) -> None:
        """Keeps a batch of frames, and learns when there are twice as many as the last time.

        The arguments and errors are those of `Frames.add`; once the dataset is learned, frames of
        it change nothing.
        """
        if self.is_finished:
            return
        self.frames.add(index, episode, percepts, actions, tasks)
        if self.frames.are_all:
            self.consolidate()
        elif self._learns_from_parts and len(self.frames) >= max(ENOUGH, 2 * self._tried):
            with suppress(ValueError):  # there may be enough to learn from later
                self.consolidate()

    @property
    def _learns_from_parts(self) -> bool:
        """Whether a frame says something without its neighbours: its action does."""
        return self.config.targets == "action"

    def consolidate(self) -> None:
        """Makes the imitator what the base becomes by watching all that came, in order.

        Where targets are states, that is once all frames have come: which state followed which
        action cannot be seen before.

        Raises:
            ValueError: nothing can be learned from that; the imitator is what it was.
        """
        count = len(self.frames)
        if self.is_finished or count == self._learned:
            return
        if not (self._learns_from_parts or self.frames.are_all):
            return
        self._tried = count
        state = len(next(iter(self.dataset.names.values())))
        shown = self.frames.episodes(state)
        new = self._demonstrations([one for one in shown if content_of(one) not in self.known])
        if self.base is None:
            targets = cast(Any, self.config.targets)
            imitator = Imitator.from_demonstrations(new, targets, self.config.lead)
        else:
            imitator = copy.deepcopy(self.base)
        imitator.learn(new)
        self.imitator, self._learned = imitator, count
        if self.frames.are_all:
            self.known = self.contents()
            self.base, self.is_finished = None, True
            self.frames = Frames(0, 0, 0)

    def contents(self) -> frozenset[str]:
        """Digests of all demonstrations that the imitator knows."""
        state = len(next(iter(self.dataset.names.values())))
        return self.known | {content_of(one) for one in self.frames.episodes(state)}

    def save(self, folder: Path) -> None:
        """Writes the imitator into a folder of its own, and what it takes to go on.

        Args:
            folder: of the checkpoint, which is there.
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

    @classmethod
    def load(cls, config: PACNetConfig, folder: Path) -> Training | None:
        """Reads what `save` wrote; None if there is nothing.

        Raises:
            ValueError: a damaged file, or settings other than those it was learned with.
        """
        from safetensors import safe_open

        if not (folder / STATE).is_file():
            return None
        with safe_open(folder / STATE, framework="pt") as file:
            facts = json.loads(file.metadata()["training"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        base = Imitator.from_pretrained(folder / BASE) if facts["has_base"] else None
        dataset, known = DatasetDescription(**facts["dataset"]), frozenset(facts["known"])
        training = cls(config, dataset, base, known)
        if facts["finished"]:
            training.is_finished, training.frames = True, Frames(0, 0, 0)
        else:
            training.frames.restore(tensors, facts["tasks"])
        training._learned = training._tried = facts["learned"]
        if (folder / IMITATOR).is_dir():
            training.imitator = Imitator.from_pretrained(folder / IMITATOR)
            _check_settings(config, training.imitator)
        return training

    def _demonstrations(self, episodes: Any) -> Demonstrations:
        dataset = self.dataset
        return Demonstrations(dataset.fps, dataset.names, tuple(episodes), dataset.source)


def _check_settings(config: PACNetConfig, base: Imitator) -> None:
    wanted, got = base.config.targets, config.targets
    if wanted != got:
        raise ValueError(f"expected policy.targets={wanted}, as learned before, got {got}")
    wanted, got = base.config.lead, config.lead
    if wanted != got and base.config.targets == "state":
        raise ValueError(f"expected policy.lead={wanted}, as learned before, got {got}")
