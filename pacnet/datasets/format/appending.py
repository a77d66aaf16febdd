"""A LeRobot dataset to append to: its files, checked, and the numbers of the next ones.

New frames and episodes go to the next files of their kind, as with LeRobot's own writers; readers
take all files in `data/` and `meta/episodes/`.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyarrow import types

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.appending_videos import next_video_files
from pacnet.datasets.format.features import Recording
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.info import INFO, VIDEO, new_info, read_appendable_info
from pacnet.datasets.format.matching import check_same
from pacnet.datasets.format.parquet import (
    as_indices,
    count_rows,
    is_list,
    open_parquet,
    read_columns,
    read_table,
    to_numpy,
)
from pacnet.datasets.format.paths import path_for_file, path_inside
from pacnet.datasets.format.tables import TASKS, episode_files, read_tasks

STATISTICS = "meta/stats.json"
EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_POINTERS = (
    "data/chunk_index", "data/file_index", "dataset_to_index", "meta/episodes/chunk_index",
    "meta/episodes/file_index",
)  # fmt: skip


class Dataset(NamedTuple):
    """A dataset to append to."""

    root: Path
    info: dict[str, Any]
    tasks: list[str]
    data_files: list[FileNumber]  # in their order
    next_data_file: FileNumber
    next_episodes_file: FileNumber
    next_video_files: dict[str, FileNumber]  # by camera
    episodes_schema: pa.Schema | None  # None: any

    @property
    def dimensions(self) -> dict[str, int]:
        """Feature of numbers -> number of its dimensions, index columns included."""
        features = self.info["features"].items()
        return {name: entry["shape"][0] for name, entry in features if entry["dtype"] != VIDEO}

    def data_path(self, number: FileNumber) -> str:
        """Return the path of a data file in the dataset's folder."""
        return self.info["data_path"].format(**number._asdict())

    def data_paths(self) -> list[Path]:
        """Return the paths of the data files, which no link leads out of the dataset."""
        return [path_inside(self.root, self.data_path(number)) for number in self.data_files]

    def episodes_path(self) -> str:
        """Return the path of the next file of episodes in the dataset's folder."""
        return EPISODES_PATH.format(**self.next_episodes_file._asdict())


def open_dataset(root: Path, recording: Recording) -> Dataset:
    """Return the dataset that a recording is appended to, or a new one.

    Raises:
        DatasetError: the dataset cannot be read, or its files contradict one another.
        ValueError: it has another `fps`, other features or another robot.
    """
    if (root / INFO).exists():
        dataset = _read_dataset(root)
        check_same(root, dataset.info, recording)
        for path in dataset.data_paths():
            _check_data_file(path, dataset.dimensions)
        for path in episode_files(root):
            _check_extremes(path, dataset.info["features"])
    else:
        _check_no_files(root)
        dataset = _empty_dataset(root, new_info(recording))
    data_path = dataset.data_path(dataset.next_data_file)
    for path in (INFO, STATISTICS, TASKS, data_path, dataset.episodes_path()):
        path_for_file(root, path)
    return dataset


def check_orphans(dataset: Dataset, written: Iterable[str]) -> None:
    """Refuse data files that belong to no episode, except those that are `written` over."""
    paths = {*map(dataset.data_path, dataset.data_files), *written}
    known = {dataset.root / path for path in paths}
    for path in sorted((dataset.root / "data").glob("*/*.parquet")):
        if path not in known:
            raise DatasetError(f"{path} holds frames of no episode: move it away")


def _check_no_files(root: Path) -> None:
    """Refuse files without a description: a new dataset would overwrite them."""
    for folder in (root / "data", root / "meta"):
        if any(path.is_file() for path in folder.rglob("*")):
            raise DatasetError(
                f"{root} has files in {folder.name}/ and no {INFO}: bring it back, or move data/ "
                "and meta/ away to begin a new dataset"
            )


def _empty_dataset(root: Path, info: dict[str, Any]) -> Dataset:
    first, videos = FileNumber(0, 0), next_video_files(root, info)
    return Dataset(root, info, [], [], first, first, videos, None)


def _read_dataset(root: Path) -> Dataset:
    """Read a dataset; LeRobot makes some without an episode."""
    info = read_appendable_info(root)
    paths = episode_files(root)
    if not paths and (info.get("total_frames"), info.get("total_episodes")) == (0, 0):
        return _empty_dataset(root, info)
    if not paths:
        raise DatasetError(f"{root} has no meta/episodes/chunk-*/file-*.parquet")
    rows = np.concatenate([_pointers(path) for path in paths])
    if not len(rows):
        raise DatasetError(f"{root}: expected episodes in meta/episodes, found none")
    files = [FileNumber(*pair) for pair in dict.fromkeys(map(tuple, rows[:, :2].tolist()))]
    with open_parquet(paths[-1]) as file:
        schema = file.schema_arrow
    dataset = Dataset(
        root,
        info,
        _ordered_tasks(root),
        files,
        files[-1].next(info["chunks_size"]),
        FileNumber(*rows[-1, 3:].tolist()).next(info["chunks_size"]),
        next_video_files(root, info),
        schema,
    )
    _check_counts(dataset, n_episodes=len(rows), n_frames=int(rows[-1, 2]))
    _check_next_files(dataset)
    return dataset


def _pointers(path: Path) -> NDArray[np.int64]:
    """Return where the episodes of one file are, `[episodes, pointers]`."""
    columns = read_columns(path, dict.fromkeys(_POINTERS, 1))
    return np.hstack([as_indices(path, name, rows) for name, rows in columns.items()])


def _ordered_tasks(root: Path) -> list[str]:
    tasks = read_tasks(root)
    if sorted(tasks) != list(range(len(tasks))):
        raise DatasetError(f"{root / TASKS}: expected tasks 0, 1, ..., found {sorted(tasks)}")
    return [tasks[index] for index in range(len(tasks))]


def _check_counts(dataset: Dataset, n_episodes: int, n_frames: int) -> None:
    """Refuse a dataset whose counts differ, as after a writer was killed."""
    n_rows = sum(map(count_rows, dataset.data_paths()))
    episodes, frames = (dataset.info.get(name) for name in ("total_episodes", "total_frames"))
    if (episodes, frames, frames) != (n_episodes, n_frames, n_rows):
        raise DatasetError(
            f"{dataset.root}: expected {episodes} episodes of {frames} frames as in {INFO}, found "
            f"{n_episodes} of {n_frames} in meta/episodes and {n_rows} frames in the data files"
        )


def _check_next_files(dataset: Dataset) -> None:
    """Refuse file numbers with which a new file would replace an existing one."""
    root = dataset.root
    if max(dataset.data_files) != dataset.data_files[-1]:
        raise DatasetError(f"{root}: expected the last episode in the last of its data files")
    path = path_inside(root, dataset.episodes_path())
    if path.exists():
        raise DatasetError(f"{root}: expected {path} to be numbered in meta/episodes, or not there")


def _check_data_file(path: Path, dimensions: Mapping[str, int]) -> None:
    """Refuse a data file in which a feature `[N, D]` is missing, of another type, or has gaps.

    No frame is read: Parquet counts the values and the gaps of each column.
    """
    with open_parquet(path, [*dimensions]) as file:
        empty, metadata = file.schema_arrow.empty_table(), file.metadata
    for name, dimension in dimensions.items():
        try:
            to_numpy(empty[name], dimension)
            for n_rows, chunk in _chunks(metadata, name):
                if chunk.statistics is not None and chunk.statistics.null_count:
                    raise ValueError(f"{chunk.statistics.null_count} gaps")
                if chunk.num_values != n_rows * dimension:
                    raise ValueError(
                        f"{chunk.num_values} in {n_rows} frames in place of {dimension} in each"
                    )
        except (ValueError, pa.ArrowException) as error:
            raise DatasetError(f"{path}: expected numbers in {name!r}, found {error}") from None


def _chunks(metadata: pq.FileMetaData, name: str) -> Iterator[tuple[int, pq.ColumnChunkMetaData]]:
    """Yield the number of rows and the column of each row group; a list's are its elements."""
    for group in map(metadata.row_group, range(metadata.num_row_groups)):
        for column in map(group.column, range(group.num_columns)):
            path = column.path_in_schema
            if path == name or path.startswith(f"{name}.list."):
                yield group.num_rows, column


def _check_extremes(path: Path, features: Iterable[str]) -> None:
    """Refuse a file of `meta/episodes` with a minimum or maximum that is not finite."""
    with open_parquet(path) as file:
        found = file.schema_arrow.names
    names = {f"stats/{feature}/{name}": feature for feature in features for name in ("min", "max")}
    table = read_table(path, ["episode_index", *(name for name in names if name in found)])
    for name in table.column_names[1:]:
        column = table[name]
        if not _is_finite(column):
            row = next(row for row in range(len(column)) if not _is_finite(column.slice(row, 1)))
            raise DatasetError(
                f"{path}: expected finite numbers in {names[name]!r}, found others in episode "
                f"{table['episode_index'][row]}"
            )


def _is_finite(column: pa.ChunkedArray) -> bool:
    """Return whether all numbers in nested lists are finite; gaps are skipped."""
    values = column.combine_chunks()
    while is_list(values.type):
        values = values.flatten()
    if not types.is_floating(values.type):
        return True
    return bool(np.isfinite(np.from_dlpack(values.drop_null())).all())
