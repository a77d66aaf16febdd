"""Fold the journal of a recording into its dataset, or into a new one.

All new files are staged and moved together (`staging.py`), in an order in which LeRobot reads the
old dataset until the new `meta/episodes` and `meta/info.json` are in place. The statistics cover
all frames, so each fold reads the old data files; it rewrites none of them.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.appending import STATISTICS, Dataset, check_orphans, open_dataset
from pacnet.datasets.format.features import Recording
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.info import INFO, json_bytes
from pacnet.datasets.format.parquet import read_columns, to_arrow, to_numpy
from pacnet.datasets.format.statistics import statistics
from pacnet.datasets.format.tables import TASKS, episodes_table, tasks_table
from pacnet.datasets.format.writing import (
    DataFiles,
    episode_row,
    parquet_content,
    with_index_columns,
    write_synced,
)
from pacnet.datasets.journal.episode_file import read_episode
from pacnet.datasets.journal.folding_videos import (
    EXAMPLE,
    camera_columns,
    described_videos,
    stage_videos,
)
from pacnet.datasets.journal.journal import Journal
from pacnet.datasets.journal.staging import Stage, finish_commit


def fold(journal: Journal) -> int:
    """Complete an interrupted fold, then fold all episodes of a journal; return how many.

    Raises:
        DatasetError: dataset or journal cannot be read, or its files contradict one another.
        ValueError: the dataset has got another `fps`, other features or another robot since.
    """
    finish_commit(journal.folder)
    episodes = journal.episodes()
    if episodes:
        recording, _, _ = read_episode(episodes[0])
        try:
            dataset = open_dataset(journal.root, recording)
        except DatasetError:
            raise
        except ValueError as error:
            raise ValueError(
                f"the journal in {journal.folder} was recorded into another dataset, {error}: move "
                "it away, or bring that dataset back"
            ) from None
        stage = Stage(journal.folder)
        _stage_files(dataset, episodes, stage)
        stage.commit(episodes)
    return len(episodes)


def check_ready(root: Path, recording: Recording) -> None:
    """Raise what `fold` would raise if the journal had an episode of this recording."""
    dataset = open_dataset(root, recording)
    check_orphans(dataset, [dataset.data_path(dataset.next_data_file)])
    # Describe an episode of one frame, to see whether the columns of `meta/episodes` take it.
    columns = {
        name: to_arrow(np.zeros((1, len(feature.names)), feature.dtype))
        for name, feature in recording.features.items()
    }
    frame = _with_index_columns(dataset, pa.table(columns), 0, 0, 0)
    row = _episode_row(dataset, frame, "task", dataset.next_data_file)
    for camera in recording.cameras:
        row |= camera_columns(camera, *EXAMPLE)
    _episodes_content(dataset, [row])


def _stage_files(dataset: Dataset, episodes: Sequence[Path], stage: Stage) -> None:
    """Write the dataset's next files, those that a reader opens first at the end."""
    tasks = list(dataset.tasks)
    new_paths, rows = _stage_frames(dataset, episodes, tasks, stage)
    pictures = stage_videos(dataset, episodes, rows, stage)
    check_orphans(dataset, stage.paths)
    _write(stage, STATISTICS, json_bytes(_statistics_of(dataset, new_paths) | pictures))
    _write(stage, TASKS, parquet_content(tasks_table(tasks)))
    _write(stage, dataset.episodes_path(), _episodes_content(dataset, rows))
    counts = {
        "total_episodes": dataset.info["total_episodes"] + len(rows),
        "total_frames": rows[-1]["dataset_to_index"],
        "total_tasks": len(tasks),
    }
    splits = {"splits": {"train": f"0:{counts['total_episodes']}"}}
    _write(stage, INFO, json_bytes(dataset.info | counts | splits | described_videos(dataset)))


def _statistics_of(dataset: Dataset, new_paths: Sequence[Path]) -> dict[str, Any]:
    """Return the statistics of all frames, by feature; each file is read once."""
    files = [read_columns(path, dataset.dimensions) for path in (*dataset.data_paths(), *new_paths)]
    found = {}
    for name in dataset.dimensions:
        rows = np.concatenate([columns.pop(name) for columns in files])
        if not np.isfinite(rows).all():  # although the statistics of its episode are
            raise DatasetError(f"expected finite numbers in {name!r}, found others in old frames")
        found[name] = statistics(rows)
    return found


def _stage_frames(
    dataset: Dataset, episodes: Sequence[Path], tasks: list[str], stage: Stage
) -> tuple[list[Path], list[dict[str, Any]]]:
    """Write the new data files and return them with the episodes' rows; new tasks are added."""
    rows: list[dict[str, Any]] = []
    start, first = dataset.info["total_frames"], read_episode(episodes[0])[0]
    with DataFiles(
        dataset.info,
        dataset.next_data_file,
        lambda number: stage.add(dataset.data_path(number)),
    ) as files:
        for index, path in enumerate(episodes, start=dataset.info["total_episodes"]):
            recording, task, table = read_episode(path)
            if recording._replace(robot_type=None) != first._replace(robot_type=None):
                raise DatasetError(f"{path} is of another recording than {episodes[0].name}")
            if task not in tasks:
                tasks.append(task)
            table = _with_index_columns(dataset, table, start, index, tasks.index(task))
            rows.append(_episode_row(dataset, table, task, files.add(table)))
            start += len(table)
    return files.paths, rows


def _with_index_columns(
    dataset: Dataset, table: pa.Table, start: int, episode: int, task: int
) -> pa.Table:
    """Return an episode's features and index columns, in the dataset's order."""
    table = with_index_columns(table, dataset.info["fps"], start, episode, task)
    return table.select([*dataset.dimensions])


def _episode_row(
    dataset: Dataset, table: pa.Table, task: str, data_file: FileNumber
) -> dict[str, Any]:
    """Return an episode's row in `meta/episodes`."""
    found = {
        f"stats/{feature}/{name}": value
        for feature, dimension in dataset.dimensions.items()
        for name, value in statistics(to_numpy(table[feature], dimension)).items()
    }
    return episode_row(table, [task], found, data_file, dataset.next_episodes_file)


def _episodes_content(dataset: Dataset, rows: Sequence[dict[str, Any]]) -> pa.Buffer:
    """Return the next file of episodes, in the columns of the older ones."""
    try:
        return parquet_content(episodes_table(rows, dataset.episodes_schema))
    except pa.ArrowException as error:
        raise DatasetError(
            f"expected columns in meta/episodes that new episodes fit into: {error}"
        ) from error


def _write(stage: Stage, path: str, content: bytes | pa.Buffer) -> None:
    write_synced(stage.add(path), content)
