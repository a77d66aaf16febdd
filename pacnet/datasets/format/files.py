"""A LeRobot dataset (format v3.0) as somebody finds it who wants to append to it, or begins one.

New frames and episodes go to the next files of their kind, as with LeRobot's own writers; readers
take all files in `data/` and `meta/episodes/`.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format.description import OWN_COLUMNS, check_appendable
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.features import Recording
from pacnet.datasets.format.lerobot_files import (
    FORMAT_VERSION,
    INFO,
    TASKS,
    read_all_tasks,
    read_description,
)
from pacnet.datasets.format.parquet_files import count_rows, integers, opened, read_columns
from pacnet.datasets.format.places import free_for_file, within

if TYPE_CHECKING:
    import pyarrow as pa

STATISTICS = "meta/stats.json"
_EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_FRAMES = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
# What LeRobot takes for granted where a dataset does not say it.
_DEFAULTS = {"chunks_size": 1000, "data_files_size_in_mb": 100, "data_path": _FRAMES}
_POINTERS = (
    "data/chunk_index",
    "data/file_index",
    "dataset_to_index",
    "meta/episodes/chunk_index",
    "meta/episodes/file_index",
)


class FileNumber(NamedTuple):
    """Which of the files of one kind."""

    chunk_index: int
    file_index: int

    def next(self, chunks_size: int) -> "FileNumber":
        """The one after it, in chunks of so many."""
        if self.file_index == chunks_size - 1:
            return FileNumber(self.chunk_index + 1, 0)
        return FileNumber(self.chunk_index, self.file_index + 1)


class Dataset(NamedTuple):
    """What is to be known of a dataset to append to it."""

    info: dict[str, Any]
    tasks: list[str]
    frame_files: list[FileNumber]  # that are there, in their order
    next_frames: FileNumber
    next_episodes: FileNumber
    episodes_schema: "pa.Schema | None"  # None: any

    def frames_place(self, number: FileNumber) -> str:
        """Where a file of frames lies in the dataset's folder."""
        return self.info["data_path"].format(**number._asdict())

    def frames_path(self, root: Path, number: FileNumber) -> Path:
        """The path of a file of frames, which no link leads out of the dataset."""
        return within(root, self.frames_place(number))

    def episodes_place(self) -> str:
        """Where the next file of episodes lies in the dataset's folder."""
        return _EPISODES.format(**self.next_episodes._asdict())


def new_dataset(recording: Recording) -> Dataset:
    """A dataset without any episode yet."""
    features = {
        name: {"dtype": told.dtype, "shape": [len(told.names)], "names": list(told.names)}
        for name, told in recording.features.items()
    }
    own = {
        name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in OWN_COLUMNS.items()
    }
    info = {
        "codebase_version": FORMAT_VERSION,
        "robot_type": recording.robot_type,
        "total_episodes": 0,
        "total_frames": 0,
        "total_tasks": 0,
        "chunks_size": _DEFAULTS["chunks_size"],
        "data_files_size_in_mb": _DEFAULTS["data_files_size_in_mb"],
        "video_files_size_in_mb": 200,
        "fps": recording.fps,
        "splits": {},
        "data_path": _FRAMES,
        "video_path": None,
        "features": features | own,
    }
    return _without_episodes(info)


def _without_episodes(info: dict[str, Any]) -> Dataset:
    return Dataset(info, [], [], FileNumber(0, 0), FileNumber(0, 0), None)


def read_dataset(root: Path) -> Dataset:
    """A dataset that is there, be it without an episode as LeRobot makes it.

    Raises:
        DatasetError: It cannot be read, or its files contradict one another.
    """
    info = read_description(root)
    info |= _DEFAULTS | info
    check_appendable(root / INFO, info)
    paths = sorted((root / "meta" / "episodes").glob("*/*.parquet"))
    if not paths and (info.get("total_frames"), info.get("total_episodes")) == (0, 0):
        return _without_episodes(info)
    if not paths:
        raise DatasetError(f"{root} has no meta/episodes/chunk-*/file-*.parquet")
    rows = np.concatenate([_pointers(path) for path in paths])
    if not len(rows):
        raise DatasetError(f"{root}: expected episodes in meta/episodes, found none")
    files = [FileNumber(*pair) for pair in dict.fromkeys(map(tuple, rows[:, :2].tolist()))]
    size = info["chunks_size"]
    dataset = Dataset(
        info,
        _read_tasks(root),
        files,
        files[-1].next(size),
        FileNumber(*rows[-1, 3:].tolist()).next(size),
        _schema(paths[-1]),
    )
    _check_counts(root, dataset, episodes=len(rows), frames=int(rows[-1, 2]))
    _check_next(root, dataset)
    return dataset


def _check_next(root: Path, dataset: Dataset) -> None:
    """Refuse numbers of files after which a new one would replace one that is there."""
    if max(dataset.frame_files) != dataset.frame_files[-1]:
        raise DatasetError(f"{root}: expected the last episode in the last of its files of frames")
    path = within(root, dataset.episodes_place())
    if path.exists():
        raise DatasetError(f"{root}: expected {path} to be numbered in meta/episodes, or not there")


def check_places(root: Path, dataset: Dataset) -> None:
    """Refuse a dataset with places that no file can be put at, or that a link leads out of it.

    Raises:
        DatasetError: There is one.
    """
    frames = dataset.frames_place(dataset.next_frames)
    for place in (INFO, STATISTICS, TASKS, frames, dataset.episodes_place()):
        free_for_file(root, place)


def _pointers(path: Path) -> NDArray[np.generic]:
    """Where the episodes of one file are, [episodes, pointers]."""
    columns = read_columns(path, dict.fromkeys(_POINTERS, 1))
    return np.hstack([integers(path, name, rows) for name, rows in columns.items()])


def _schema(path: Path) -> "pa.Schema":
    with opened(path) as file:
        return file.schema_arrow


def _read_tasks(root: Path) -> list[str]:
    """All tasks in words, by their numbers."""
    told = read_all_tasks(root)
    if sorted(told) != list(range(len(told))):
        raise DatasetError(f"{root / TASKS}: expected tasks 0, 1, ..., found {sorted(told)}")
    return [told[number] for number in range(len(told))]


def _check_counts(root: Path, dataset: Dataset, episodes: int, frames: int) -> None:
    """Refuse a dataset that a killed writer left in pieces, before anything is added to it."""
    info = dataset.info
    rows = sum(count_rows(dataset.frames_path(root, number)) for number in dataset.frame_files)
    frames_told = info.get("total_frames")
    counted = (info.get("total_episodes"), frames_told, frames_told)
    if counted != (episodes, frames, rows):
        raise DatasetError(
            f"{root}: expected {counted[0]} episodes of {counted[1]} frames as in {INFO}, found "
            f"{episodes} of {frames} in meta/episodes and {rows} frames in the data files"
        )


def features_of(
    paths: Sequence[Path], dimensions: Mapping[str, int]
) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Each feature of all frames in these files, [N, D]; every file is read once.

    Args:
        paths: The files.
        dimensions: Name of each feature -> D.
    """
    files = [read_columns(path, dimensions) for path in paths]
    for name in dimensions:
        yield name, np.concatenate([columns.pop(name) for columns in files])
