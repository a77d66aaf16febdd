"""The frames of a dataset as a training run comes upon them, and the episodes they add up to."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import torch
from torch import Tensor

from pacnet.datasets.demonstrations import Demonstration

_UNSEEN = -1  # episode of a frame that has not come yet


class Frames:
    """Frames in any order, some of them twice, kept in the order of the dataset.

    Args:
        count: number of frames of the dataset.
        percept: length of a percept D.
        action: length of an action U.
    """

    def __init__(self, count: int, percept: int, action: int) -> None:
        self.percepts = torch.zeros(count, percept)  # [N, D]
        self.actions = torch.zeros(count, action)  # [N, U]
        self.episode = torch.full((count,), _UNSEEN)  # [N]
        self._tasks: dict[int, tuple[int, str]] = {}  # episode -> its earliest frame, and the task
        self._count = 0

    def __len__(self) -> int:
        """The number of different frames that have come."""
        return self._count

    @property
    def are_all(self) -> bool:
        """Whether every frame of the dataset has come."""
        return len(self) == len(self.episode)

    def add(
        self,
        index: Tensor,
        episode: Tensor,
        percepts: Tensor,
        actions: Tensor,
        tasks: Sequence[str],
    ) -> None:
        """Takes in a batch of frames.

        Args:
            index: of each frame in the dataset, int64 `[B]`.
            episode: that it is from, int64 `[B]`.
            percepts: `[B, D]`.
            actions: `[B, U]`.
            tasks: what is shown, in words, B of them.

        Raises:
            ValueError: an index that the dataset does not have, or numbers that are not finite;
                no frame has been taken in.
        """
        outside = (index < 0) | (index >= len(self.episode))
        if bool(outside.any()):
            raise ValueError(
                f"expected frames from 0 to {len(self.episode) - 1}, got index "
                f"{int(index[outside][0])}: the dataset's metadata counts fewer than there are"
            )
        finite = torch.cat([percepts, actions], dim=1).isfinite().all(dim=1)
        if not bool(finite.all()):
            raise ValueError(
                f"expected finite numbers, got others at index {int(index[~finite][0])} "
                f"(episode {int(episode[~finite][0])})"
            )
        self._count += len(index[self.episode[index] == _UNSEEN].unique())
        self.percepts[index], self.actions[index], self.episode[index] = percepts, actions, episode
        for number, frame, task in zip(episode.tolist(), index.tolist(), tasks, strict=True):
            if number not in self._tasks or frame < self._tasks[number][0]:
                self._tasks[number] = (frame, task)

    def episodes(self, state: int) -> list[Demonstration]:
        """What has come of each episode, in the order of the dataset.

        Args:
            state: how many of a percept's dimensions, the first ones, are the robot's state.
        """
        seen = (self.episode != _UNSEEN).nonzero().flatten()
        numbers, lengths = self.episode[seen].unique_consecutive(return_counts=True)
        return [
            Demonstration(
                number,
                self._tasks[number][1],
                self.percepts[rows, :state],
                self.percepts[rows, state:],
                self.actions[rows],
            )
            for number, rows in zip(numbers.tolist(), seen.split(lengths.tolist()), strict=True)
        ]

    def tensors(self) -> tuple[dict[str, Tensor], list[list[int | str]]]:
        """What has come, as tensors, and the tasks as rows of JSON."""
        seen = (self.episode != _UNSEEN).nonzero().flatten()
        tensors = {
            "index": seen,
            "episode": self.episode[seen],
            "percepts": self.percepts[seen],
            "actions": self.actions[seen],
        }
        return tensors, [[number, *task] for number, task in self._tasks.items()]

    def restore(self, tensors: dict[str, Tensor], tasks: Sequence[Sequence[int | str]]) -> None:
        """Takes in what `tensors` gave."""
        seen = tensors["index"]
        self._count = len(seen)
        self.episode[seen] = tensors["episode"]
        self.percepts[seen], self.actions[seen] = tensors["percepts"], tensors["actions"]
        self._tasks = {int(number): (int(frame), str(task)) for number, frame, task in tasks}


def content_of(shown: Demonstration) -> str:
    """Digest of what a demonstration shows: two of one content are one, wherever they are kept."""
    digest = hashlib.sha256(shown.task.encode())
    digest.update(shown.percepts.numpy().tobytes())
    digest.update(shown.action.numpy().tobytes())
    return digest.hexdigest()
