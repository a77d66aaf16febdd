"""Where the frames of a dataset to be copied are: files and rows of each episode, and its tasks.

All layouts are alike here: the data files are those in `data/`, however they are named,
and a column of each says which episode its rows belong to.
"""

import warnings
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.data_files import (
    EPISODE,
    FRAME,
    INDEX,
    TASK,
    TIME,
    data_paths,
    read_data_file,
)
from pacnet.datasets.format.episode_list import ListedEpisode, listed_episodes
from pacnet.datasets.format.features import is_text
from pacnet.datasets.format.frame_rows import Rows
from pacnet.datasets.format.info import FORMAT_VERSION, read_info
from pacnet.datasets.format.numbers import episodes_text, numbers_text
from pacnet.datasets.format.paths import path_of_source
from pacnet.datasets.format.tables import read_tasks

_UNTITLED = "untitled"  # LeRobot needs a task in words


class SourceEpisode(NamedTuple):
    """An episode of a dataset to be copied."""

    number: int  # its index in the dataset
    parts: tuple[Rows, ...]
    tasks: tuple[str, ...]  # of each frame
    times: NDArray[Any] | None  # [T] in s; None if they are not known

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.tasks)


class Source(NamedTuple):
    """A dataset to be copied: the episodes that are wanted, in the order of the copy."""

    root: Path
    info: dict[str, Any]
    episodes: list[SourceEpisode]
    is_whole: bool  # whether these are all episodes of the dataset

    @property
    def is_old(self) -> bool:
        """Whether the format is v2.0 or v2.1."""
        return self.info["codebase_version"] != FORMAT_VERSION

    @property
    def data_files(self) -> list[Path]:
        """The data files that hold the episodes."""
        return [*dict.fromkeys(part.path for one in self.episodes for part in one.parts)]


class _Part(NamedTuple):
    """The frames of an episode that are in one file."""

    path: Path
    rows: NDArray[np.int64]  # [T]
    order: NDArray[np.int64]  # [T], what they are sorted by
    tasks: NDArray[np.int64] | None  # [T]
    times: NDArray[Any] | None  # [T]


def read_source(
    root: Path, selected: Sequence[int] | None = None, *, skip_damaged: bool = False
) -> Source:
    """Find the frames of the selected episodes, or of all; no feature is read.

    Files that cannot be read are passed over where episodes are selected.

    Args:
        root: the dataset's folder.
        selected: the episodes' indices, in the order of the copy; None for all.
        skip_damaged: whether a table of tasks that cannot be read is done without.

    Raises:
        DatasetError: the dataset cannot be read.
        ValueError: no episode is selected, one twice, or one that the dataset does not have.
    """
    info = read_info(root)
    found: dict[int, list[_Part]] = {}
    damaged: list[DatasetError] = []
    for path in data_paths(root):
        try:
            _add_parts(path_of_source(root, path.relative_to(root).as_posix()), found)
        except DatasetError as error:
            if selected is None:
                raise
            damaged.append(error)
    wanted = sorted(found) if selected is None else [*selected]
    unknown = [index for index in wanted if index not in found]
    if unknown and damaged:
        raise damaged[0]
    if unknown or not wanted or len({*wanted}) < len(wanted):
        raise ValueError(
            f"expected different episodes of {numbers_text(found)}, at least one, got {wanted}"
        )
    texts = _Tasks(root, info, skip_damaged)
    episodes = [_episode(index, found[index], texts) for index in wanted]
    if texts.untitled:
        about = episodes_text(texts.untitled)
        _warn(f"The dataset has no task in words in {about}: {_UNTITLED!r} in the copy")
    return Source(root, info, episodes, is_whole=len(wanted) == len(found) and not damaged)


def _add_parts(path: Path, found: dict[int, list[_Part]]) -> None:
    """Add the frames of one data file to those of their episodes."""
    columns = read_data_file(path, [], {})
    episodes = columns[EPISODE]
    everything = np.arange(len(episodes))
    order = columns.get(INDEX, columns.get(FRAME, everything))
    for index in np.unique(episodes).tolist():
        rows = np.flatnonzero(episodes == index)
        rows = rows[np.argsort(order[rows], kind="stable")]
        tasks = columns[TASK][rows] if TASK in columns else None
        times = columns[TIME][rows] if TIME in columns else None
        found.setdefault(index, []).append(_Part(path, rows, order[rows], tasks, times))


class _Tasks:
    """The tasks of a dataset in words: by their numbers, else by episode as these are listed."""

    def __init__(self, root: Path, info: dict[str, Any], skip_damaged: bool) -> None:
        self.untitled: list[int] = []  # episodes that no task in words was found for
        self._listed: dict[int, ListedEpisode] | None = None
        self._root, self._info, self._skip_damaged = root, info, skip_damaged
        try:
            self._texts = read_tasks(root)
        except DatasetError as error:
            if not skip_damaged:
                raise
            self._texts = {}
            _warn(f"{error}: tasks are taken from the episodes' list")

    def of(self, index: int, numbers: NDArray[np.int64] | None, length: int) -> tuple[str, ...]:
        """Return the task of each frame of an episode; `_UNTITLED` where there is none in words."""
        if numbers is None:
            texts = [""] * length
        else:
            unknown = sorted({*numbers.tolist()} - {*self._texts})
            if unknown and not self._skip_damaged:
                raise DatasetError(f"expected the tasks {unknown}, found {sorted(self._texts)}")
            texts = [self._texts.get(number, "") for number in numbers.tolist()]
        if all(map(_is_task, texts)):
            return tuple(texts)
        if self._listed is None:
            self._listed = listed_episodes(self._root, self._info)
        task = self._listed[index].task if index in self._listed else None
        if not _is_task(task):
            task = _UNTITLED
            self.untitled.append(index)
        return tuple(text if _is_task(text) else task for text in texts)


def _is_task(text: object) -> TypeGuard[str]:
    return is_text(text) and bool(text.strip())


def _warn(text: str) -> None:
    warnings.warn(text, DatasetWarning, stacklevel=4)


def _episode(index: int, parts: list[_Part], texts: _Tasks) -> SourceEpisode:
    """Return an episode with its files in the order of its frames."""
    parts = sorted(parts, key=lambda part: part.order[0])
    if any(before.order[-1] >= after.order[0] for before, after in pairwise(parts)):
        raise DatasetError(
            f"expected the frames of episode {index} in one file after the other, found them mixed"
        )
    numbers = [part.tasks for part in parts if part.tasks is not None]
    known = np.concatenate(numbers) if len(numbers) == len(parts) else None
    tasks = texts.of(index, known, sum(len(part.rows) for part in parts))
    stored = [part.times for part in parts if part.times is not None]
    times = np.concatenate(stored) if len(stored) == len(parts) else None
    rows = tuple(Rows(part.path, part.rows) for part in parts)
    return SourceEpisode(index, rows, tasks, times)
