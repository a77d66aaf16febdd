"""A copy of a dataset in format v3.0: its frames at the level of Arrow tables, its videos as files.

Values are kept as they are stored. The index columns, the description and the statistics of numbers
are made anew. Videos are hard links where the file system can make them.
"""

import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pacnet.core.durable import open_synced
from pacnet.datasets.copying.axes import as_scalars, to_rows
from pacnet.datasets.copying.copied_rows import copied_episodes_table, statistics_of
from pacnet.datasets.copying.kept_columns import Kept
from pacnet.datasets.copying.picture_statistics import PictureStatistics
from pacnet.datasets.copying.source import Source, SourceEpisode
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.appending import EPISODES_PATH, STATISTICS
from pacnet.datasets.format.clips import Clip
from pacnet.datasets.format.features import INDEX_COLUMNS, Arrays
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.frame_rows import FrameReader
from pacnet.datasets.format.info import INFO, image_features, json_bytes
from pacnet.datasets.format.parquet import is_list, read_table, to_arrow
from pacnet.datasets.format.paths import DATA_PATH, VIDEO_PATH, path_of_source, real_path
from pacnet.datasets.format.tables import TASKS, tasks_table
from pacnet.datasets.format.writing import (
    DataFiles,
    episode_row,
    parquet_content,
    with_index_columns,
    write_synced,
)

_SUBTASKS = "meta/subtasks.parquet"  # what the numbers in `subtask_index` mean
_FIRST = FileNumber(0, 0)


class Plan(NamedTuple):
    """Everything about a copy, checked before it is begun."""

    source: Source
    info: dict[str, Any]  # of the copy, with its features and counts
    tasks: list[str]
    kept: Kept  # features of the data files
    clips: Mapping[str, list[Clip]]  # camera -> the clip of each episode
    pictures: PictureStatistics
    columns: list[Arrays]  # of each episode: extra column -> [T, K]

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Feature of numbers -> its shape, extra and index columns included."""
        extra = {name: (rows.shape[1],) for name, rows in self.columns[0].items()}
        return self.kept.shapes | extra | dict.fromkeys(INDEX_COLUMNS, (1,))


def write_copy(plan: Plan, folder: Path, progress: Callable[[int], object]) -> None:
    """Write a copy into an empty folder; `progress` is called with the frames written."""
    rows, paths = _write_frames(plan, folder, progress)
    for camera, clip in _distinct_files(plan.clips):
        place = VIDEO_PATH.format(video_key=camera, **clip.number._asdict())
        _link(clip.path, _made(folder / place))
    subtasks = path_of_source(plan.source.root, _SUBTASKS)
    if subtasks.is_file():
        write_synced(_made(folder / _SUBTASKS), parquet_content(read_table(subtasks)))
    cameras = image_features(plan.info)
    table = copied_episodes_table(rows, plan.shapes, plan.clips, cameras, plan.pictures)
    write_synced(_made(folder / EPISODES_PATH.format(**_FIRST._asdict())), parquet_content(table))
    write_synced(folder / TASKS, parquet_content(tasks_table(plan.tasks)))
    write_synced(folder / STATISTICS, json_bytes(_statistics(plan, paths)))
    write_synced(folder / INFO, json_bytes(plan.info))


def _write_frames(
    plan: Plan, folder: Path, progress: Callable[[int], object]
) -> tuple[list[dict[str, Any]], list[Path]]:
    """Write the data files; return the episodes' rows and the files' paths."""
    reader, rows, start = FrameReader([*plan.kept.features]), [], 0

    def place(number: FileNumber) -> Path:
        return _made(folder / DATA_PATH.format(**number._asdict()))

    with DataFiles(plan.info, _FIRST, place) as files:
        for index, episode in enumerate(plan.source.episodes):
            table = _checked_frames(plan, episode, reader.frames(episode.parts))
            for name, values in plan.columns[index].items():
                table = table.append_column(name, to_arrow(values))
            numbers = np.array([plan.tasks.index(task) for task in episode.tasks])
            table = with_index_columns(table, plan.info["fps"], start, index, numbers)
            found = {
                f"stats/{name}/{kind}": values
                for name, shape in plan.shapes.items()
                for kind, values in statistics_of(to_rows(table[name], shape)).items()
            }
            tasks = [*dict.fromkeys(episode.tasks)]
            rows.append(episode_row(table, tasks, found, files.add(table), _FIRST))
            start += len(table)
            progress(len(table))
    return rows, files.paths


def _checked_frames(plan: Plan, episode: SourceEpisode, table: pa.Table) -> pa.Table:
    """Return the frames with lists of one value as scalars, which LeRobot expects."""
    columns = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        shape = plan.kept.shapes.get(name)
        try:
            if shape is not None:
                to_rows(column, shape)
        except (ValueError, pa.ArrowException) as error:
            raise DatasetError(
                f"{plan.source.root}: expected {name!r} as in meta/info.json, found {error} in "
                f"episode {episode.number}"
            ) from None
        is_single = plan.kept.features[name]["shape"] == [1] and is_list(column.type)
        columns[name] = as_scalars(column) if is_single else column
    return pa.table(columns)


def _statistics(plan: Plan, paths: Sequence[Path]) -> dict[str, Any]:
    """Return the statistics of all frames, by feature; one feature is in memory at a time."""
    found: dict[str, Any] = {}
    for name, shape in plan.shapes.items():
        rows: NDArray[Any] = np.concatenate(
            [to_rows(read_table(path, [name])[name], shape) for path in paths]
        )
        stats = statistics_of(rows)
        if stats:
            found[name] = stats
    for name, stats in plan.pictures.of_all.items():
        found[name] = {kind: values.tolist() for kind, values in stats.items()}
    return found


def _distinct_files(clips: Mapping[str, Sequence[Clip]]) -> Iterator[tuple[str, Clip]]:
    for camera, shown in clips.items():
        for clip in {clip.number: clip for clip in shown}.values():
            yield camera, clip


def _made(path: Path) -> Path:
    """Return a path whose folder is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _link(path: Path, destination: Path) -> None:
    """Give a file a second name, or copy it where the file system cannot."""
    content = real_path(path)
    try:
        os.link(content, destination)
    except OSError:
        with content.open("rb") as file, open_synced(destination) as copy:
            shutil.copyfileobj(file, copy, 2**20)
