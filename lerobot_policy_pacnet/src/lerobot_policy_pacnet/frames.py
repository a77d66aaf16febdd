"""Frames collected from shuffled batches, and the episodes they belong to."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import torch
from torch import Tensor

from lerobot_policy_pacnet.pictures import DatasetPictures
from pacnet.datasets.demonstrations import Demonstration

_MISSING = -1  # episode of a frame that has not been added yet


class Frames:
    """Collects frames in any order, also repeated ones, and keeps them in the dataset's order.

    Args:
        count: number of frames of the dataset.
        percept: length of a percept D.
        action: length of an action U.
    """

    def __init__(self, count: int, percept: int, action: int) -> None:
        self.percepts = torch.zeros(count, percept)  # [N, D]
        self.actions = torch.zeros(count, action)  # [N, U]
        self.episode = torch.full((count,), _MISSING)  # [N]
        self._tasks: dict[int, tuple[int, str]] = {}  # episode -> its first frame, task
        self._count = 0

    def __len__(self) -> int:
        """Return the number of different frames added."""
        return self._count

    @property
    def is_complete(self) -> bool:
        """Whether every frame of the dataset was added."""
        return len(self) == len(self.episode)

    def add(
        self,
        index: Tensor,
        episode: Tensor,
        percepts: Tensor,
        actions: Tensor,
        tasks: Sequence[str],
    ) -> None:
        """Add a batch of frames.

        Args:
            index: number of each frame in the dataset, int64 `[B]`.
            episode: number of its episode, int64 `[B]`.
            percepts: `[B, D]`.
            actions: `[B, U]`.
            tasks: what is shown, in words, one for each frame.

        Raises:
            ValueError: an index beyond the dataset, or values that are not finite; no frame was
                added.
        """
        outside = (index < 0) | (index >= len(self.episode))
        if bool(outside.any()):
            raise ValueError(
                f"expected frames from 0 to {len(self.episode) - 1}, got index "
                f"{int(index[outside][0])}: the dataset's metadata counts too few frames"
            )
        finite = torch.cat([percepts, actions], dim=1).isfinite().all(dim=1)
        if not bool(finite.all()):
            raise ValueError(
                f"expected finite values, got others at index {int(index[~finite][0])} "
                f"(episode {int(episode[~finite][0])})"
            )
        self._count += len(index[self.episode[index] == _MISSING].unique())
        self.percepts[index], self.actions[index], self.episode[index] = percepts, actions, episode
        for number, frame, task in zip(episode.tolist(), index.tolist(), tasks, strict=True):
            if number not in self._tasks or frame < self._tasks[number][0]:
                self._tasks[number] = (frame, task)

    def episodes(self, state: int, pictures: DatasetPictures | None = None) -> list[Demonstration]:
        """Return the frames added so far as episodes, in the order of the dataset.

        Args:
            state: how many of a percept's dimensions, the first ones, are the robot's state.
            pictures: what cameras show of them; None without any.

        Raises:
            ValueError: there are no pictures of a frame, or they cannot be read.
        """
        added = (self.episode != _MISSING).nonzero().flatten()
        numbers, lengths = self.episode[added].unique_consecutive(return_counts=True)
        if pictures is not None:
            pictures.read(numbers.tolist())
        return [
            Demonstration(
                number,
                self._tasks[number][1],
                self.percepts[rows, :state],
                self.percepts[rows, state:],
                self.actions[rows],
                pictures={} if pictures is None else pictures.of_frames(number, rows),
            )
            for number, rows in zip(numbers.tolist(), added.split(lengths.tolist()), strict=True)
        ]

    def tensors(self) -> tuple[dict[str, Tensor], list[list[int | str]]]:
        """Return the frames added so far, and the tasks as rows of JSON, for `restore`."""
        added = (self.episode != _MISSING).nonzero().flatten()
        tensors = {
            "index": added,
            "episode": self.episode[added],
            "percepts": self.percepts[added],
            "actions": self.actions[added],
        }
        return tensors, [[number, *task] for number, task in self._tasks.items()]

    def restore(self, tensors: dict[str, Tensor], tasks: Sequence[Sequence[int | str]]) -> None:
        """Restore what `tensors` returned."""
        added = tensors["index"]
        self._count = len(added)
        self.episode[added] = tensors["episode"]
        self.percepts[added], self.actions[added] = tensors["percepts"], tensors["actions"]
        self._tasks = {int(number): (int(frame), str(task)) for number, frame, task in tasks}


def content_of(shown: Demonstration) -> str:
    """Return a digest of a demonstration's content, to recognise it in another dataset."""
    digest = hashlib.sha256(shown.task.encode())
    digest.update(shown.percepts.numpy().tobytes())
    digest.update(shown.action.numpy().tobytes())
    return digest.hexdigest()
