"""A LeRobot dataset (format v3.0) as somebody finds it who wants to append to it, or begins one.

New frames and episodes go to the next files of their kind, as with LeRobot's own writers; readers
take all files in `data/` and `meta/episodes/`.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.lerobot_files import (
    FORMAT_VERSION,
    INFO,
    TASKS,
    DatasetError,
    read_all_tasks,
    read_columns,
    read_description,
    told_names,
)
from pacnet.datasets.recording import RESERVED, STORED, Recording

if TYPE_CHECKING:
    import pyarrow as pa

STATISTICS = "meta/stats.json"
_EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_FRAMES = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
# Columns that the format has beside the features.
_OWN = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
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

    def episodes_place(self) -> str:
        """Where the next file of episodes lies in the dataset's folder."""
        return _EPISODES.format(**self.next_episodes._asdict())


def new_dataset(recording: Recording) -> Dataset:
    """A dataset without any episode yet."""
    features = {
        name: {"dtype": told.dtype, "shape": [len(told.names)], "names": list(told.names)}
        for name, told in recording.features.items()
    }
    own = {name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in _OWN.items()}
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
    paths = sorted((root / "meta" / "episodes").glob("*/*.parquet"))
    if not paths and info.get("total_frames") == 0:
        return _without_episodes(info)
    if not paths:
        raise DatasetError(f"{root} has no meta/episodes/chunk-*/file-*.parquet")
    rows = np.concatenate([_pointers(path) for path in paths])
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
    return dataset


def _pointers(path: Path) -> NDArray[np.generic]:
    """Where the episodes of one file are, [episodes, pointers]."""
    return np.hstack([*read_columns(path, dict.fromkeys(_POINTERS, 1)).values()])


def _schema(path: Path) -> "pa.Schema":
    import pyarrow.parquet as pq

    return pq.read_schema(path)


def _read_tasks(root: Path) -> list[str]:
    """All tasks in words, by their numbers."""
    told = read_all_tasks(root)
    if sorted(told) != list(range(len(told))):
        raise DatasetError(f"{root / TASKS}: expected tasks 0, 1, ..., found {sorted(told)}")
    return [told[number] for number in range(len(told))]


def _check_counts(root: Path, dataset: Dataset, episodes: int, frames: int) -> None:
    """Refuse a dataset that a killed writer left in pieces, before anything is added to it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    info, rows = dataset.info, 0
    for number in dataset.frame_files:
        path = root / dataset.frames_place(number)
        try:
            rows += pq.read_metadata(path).num_rows
        except (OSError, pa.ArrowException) as error:
            raise DatasetError(f"{path} cannot be read: {error}") from error
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


def check_same(root: Path, info: dict[str, Any], recording: Recording) -> None:
    """Refuse to append a recording to a dataset of something else.

    Raises:
        ValueError: The frames per second, the features or the robot's type differ, or there are
            features that no recording has.
    """
    there = {name: told for name, told in info["features"].items() if name not in RESERVED}
    for name, told in there.items():
        if told["dtype"] not in STORED:
            raise ValueError(
                f"expected a dataset of {', '.join(STORED)}, which is what Recorder stores: with "
                f"{name!r} being {told['dtype']}, {root} cannot be appended to with it"
            )
    if recording.fps != info["fps"]:
        raise ValueError(f"expected fps {info['fps']} as in {root}, got {recording.fps}")
    if set(there) != set(recording.features):
        raise ValueError(
            f"expected the features {sorted(there)} as in {root}, got {sorted(recording.features)}"
        )
    for name, told in recording.features.items():
        expected, got = _described(there[name], told.names), (told.dtype, list(told.names))
        if expected != got:
            raise ValueError(
                f"expected {name!r} as {expected[0]} of {expected[1]} as in {root}, "
                f"got {got[0]} of {got[1]}"
            )
    robot = info.get("robot_type")
    if recording.robot_type not in (None, robot):
        raise ValueError(
            f"expected robot_type {robot!r} as in {root}, got {recording.robot_type!r}"
        )


def _described(told: dict[str, Any], otherwise: Sequence[str]) -> tuple[str, list[str]]:
    """A feature's dtype and names; a dataset may be without names."""
    names, shape = told_names(told), list(told["shape"])
    if names is not None:
        return told["dtype"], names
    return told["dtype"], list(otherwise) if shape == [len(otherwise)] else [f"shape {shape}"]
