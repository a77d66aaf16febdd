"""The journal of a recording becomes part of its dataset, or the dataset's beginning.

All new files are staged and take their places together (`staging.py`), in an order in which
LeRobot reads the dataset as it was until `meta/episodes` and `meta/info.json` are the new
ones. The statistics are those of all frames: each fold reads the old ones, and writes none of them.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pacnet.core.durable import open_synced
from pacnet.datasets.format.arrow_columns import to_arrow, to_numpy
from pacnet.datasets.format.description import check_same
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.features import Recording
from pacnet.datasets.format.files import (
    STATISTICS,
    Dataset,
    FileNumber,
    check_places,
    features_of,
    new_dataset,
    read_dataset,
)
from pacnet.datasets.format.lerobot_files import INFO, TASKS
from pacnet.datasets.format.old_frames import check_frames, check_orphans
from pacnet.datasets.format.statistics import statistics
from pacnet.datasets.format.tables import episodes_table, json_bytes, tasks_table
from pacnet.datasets.journal.frame_files import FrameFiles
from pacnet.datasets.journal.journal import Journal
from pacnet.datasets.journal.journal_files import read_episode
from pacnet.datasets.journal.staging import Stage, settle

if TYPE_CHECKING:
    import pyarrow as pa


def fold(journal: Journal) -> int:
    """Fold all episodes of a journal, after completing what a killed process began.

    Returns:
        How many episodes were folded.

    Raises:
        DatasetError: The dataset or the journal cannot be read, or the dataset's files contradict
            one another.
        ValueError: The dataset is of something else by now.
    """
    settle(journal.folder)
    episodes = journal.episodes()
    if episodes:
        dataset = _dataset_of(journal, read_episode(episodes[0])[0])
        stage = Stage(journal.folder)
        _stage_files(journal.root, dataset, episodes, stage)
        stage.commit(episodes)
    return len(episodes)


def _dataset_of(journal: Journal, recording: Recording) -> Dataset:
    """The dataset that a journal's recording belongs to."""
    try:
        return find_dataset(journal.root, recording)
    except DatasetError:
        raise
    except ValueError as error:
        raise ValueError(
            f"the journal in {journal.folder} was recorded into another dataset, {error}: move it "
            "away, or bring that dataset back"
        ) from None


def find_dataset(root: Path, recording: Recording) -> Dataset:
    """The dataset that a recording is appended to, or a new one.

    Raises:
        DatasetError: The dataset or its frames cannot be read, or its files contradict one another
            or are there without `meta/info.json`.
        ValueError: It is of something else.
    """
    if not (root / INFO).exists():
        _check_begun(root)
        dataset = new_dataset(recording)
    else:
        dataset = read_dataset(root)
        check_same(root, dataset.info, recording)
        check_frames(root, dataset)
    check_places(root, dataset)
    return dataset


def check_ready(root: Path, recording: Recording) -> None:
    """Refuse what the episodes of a recording could not be folded into.

    Raises:
        DatasetError: As `find_dataset`, or a file of frames belongs to no episode, but for the one
            that is written over.
        ValueError: As `find_dataset`.
    """
    dataset = find_dataset(root, recording)
    check_orphans(root, dataset, [dataset.frames_place(dataset.next_frames)])
    _try_frame(dataset, recording)


def _try_frame(dataset: Dataset, recording: Recording) -> None:
    """Refuse a dataset in whose columns no frame of the recording can be described."""
    import pyarrow as pa

    columns = {
        name: to_arrow(np.zeros((1, len(told.names)), told.dtype))
        for name, told in recording.features.items()
    }
    table = _with_own_columns(dataset.info, pa.table(columns), 0, 0, 0)
    row = _described(table, "task", dataset.info["features"]) | _placed("data", FileNumber(0, 0))
    _episodes_bytes(dataset, [row | _placed("meta/episodes", FileNumber(0, 0))])


def _check_begun(root: Path) -> None:
    """Refuse to begin a dataset over the files of one that has lost its description."""
    for folder in (root / "data", root / "meta"):
        if any(path.is_file() for path in folder.rglob("*")):
            raise DatasetError(
                f"{root} has files in {folder.name}/ and no {INFO}: bring it back, or move data/ "
                "and meta/ away to begin a new dataset"
            )


def _stage_files(root: Path, dataset: Dataset, episodes: Sequence[Path], stage: Stage) -> None:
    """Write the dataset's next files, those first that nobody looks for without the others."""
    tasks = list(dataset.tasks)
    fresh, rows = _stage_frames(dataset, episodes, tasks, stage)
    check_orphans(root, dataset, stage.places)
    frames = [*(dataset.frames_path(root, number) for number in dataset.frame_files), *fresh]
    whole = _statistics_of(frames, dataset.info["features"])
    _stage_bytes(stage, STATISTICS, json_bytes(whole))
    _stage_table(stage, TASKS, tasks_table(tasks))
    _stage_bytes(stage, dataset.episodes_place(), _episodes_bytes(dataset, rows))
    counts = {
        "total_episodes": dataset.info["total_episodes"] + len(rows),
        "total_frames": rows[-1]["dataset_to_index"],
        "total_tasks": len(tasks),
    }
    splits = {"splits": {"train": f"0:{counts['total_episodes']}"}}
    _stage_bytes(stage, INFO, json_bytes(dataset.info | counts | splits))


def _statistics_of(files: Sequence[Path], features: Mapping[str, Any]) -> dict[str, Any]:
    """The statistics of all frames in these files, by feature."""
    found = {}
    dimensions = {name: told["shape"][0] for name, told in features.items()}
    for name, rows in features_of(files, dimensions):
        if not np.isfinite(rows).all():  # and the statistics of its episode do not say so
            raise DatasetError(f"expected finite numbers in {name!r}, found others in old frames")
        found[name] = statistics(rows)
    return found


def _stage_frames(
    dataset: Dataset, episodes: Sequence[Path], tasks: list[str], stage: Stage
) -> tuple[list[Path], list[dict[str, Any]]]:
    """The files of the new frames and the descriptions of their episodes; new tasks are added."""
    info, rows = dataset.info, []
    start, first = info["total_frames"], read_episode(episodes[0])[0]
    with FrameFiles(dataset, stage) as files:
        for number, path in enumerate(episodes, start=info["total_episodes"]):
            recording, task, table = read_episode(path)
            if recording[:2] != first[:2]:
                raise DatasetError(f"{path} is of another recording than {episodes[0].name}")
            if task not in tasks:
                tasks.append(task)
            table = _with_own_columns(info, table, start, number, tasks.index(task))
            place = files.add(table)
            rows.append(_described(table, task, info["features"]) | _placed("data", place))
            rows[-1] |= _placed("meta/episodes", dataset.next_episodes)
            start += len(table)
    return files.paths, rows


def _with_own_columns(
    info: dict[str, Any], table: "pa.Table", start: int, episode: int, task: int
) -> "pa.Table":
    """An episode's features and the format's own columns, in the dataset's order."""
    time = np.arange(len(table), dtype=np.int64)
    own = {
        "timestamp": (time / info["fps"]).astype(np.float32),
        "frame_index": time,
        "episode_index": np.full_like(time, episode),
        "index": start + time,
        "task_index": np.full_like(time, task),
    }
    for name, column in own.items():
        table = table.append_column(name, to_arrow(column[:, None]))
    return table.select(list(info["features"]))


def _described(table: "pa.Table", task: str, features: Mapping[str, Any]) -> dict[str, Any]:
    """An episode's row in `meta/episodes`, but for where its files are."""
    start = table["index"][0].as_py()
    row = {
        "episode_index": table["episode_index"][0].as_py(),
        "tasks": [task],
        "length": len(table),
        "dataset_from_index": start,
        "dataset_to_index": start + len(table),
    }
    for feature, told in features.items():
        found = statistics(to_numpy(table[feature], told["shape"][0]))
        row |= {f"stats/{feature}/{name}": value for name, value in found.items()}
    return row


def _placed(kind: str, file: FileNumber) -> dict[str, int]:
    return {f"{kind}/{name}": number for name, number in file._asdict().items()}


def _episodes_bytes(dataset: Dataset, rows: Sequence[dict[str, Any]]) -> "pa.Buffer":
    """The next file of episodes, in the columns of the older ones."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    content = pa.BufferOutputStream()
    try:
        table = episodes_table(rows, dataset.episodes_schema)
        pq.write_table(table, content, compression="snappy")
    except pa.ArrowException as error:
        raise DatasetError(
            f"expected columns in meta/episodes that new episodes fit into: {error}"
        ) from error
    return content.getvalue()


def _stage_bytes(stage: Stage, place: str, content: "bytes | pa.Buffer") -> None:
    with open_synced(stage.add(place)) as file:
        file.write(content)


def _stage_table(stage: Stage, place: str, table: "pa.Table") -> None:
    import pyarrow.parquet as pq

    with open_synced(stage.add(place)) as file:
        pq.write_table(table, file, compression="snappy")
