"""The files of a LeRobot dataset (format v3.0), checked, as plain Python and numpy.

Of the format's files three kinds are read: `meta/info.json` describes the features and counts the
frames, `meta/tasks.parquet` names the tasks, and `data/chunk-*/file-*.parquet` hold one row per
frame, many episodes a file. Images and videos are left alone. Needs pyarrow.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.parquet_files import (
    count_rows,
    integers,
    read_columns,
    read_parquet,
)

FORMAT_VERSION = "v3.0"
INFO = "meta/info.json"
TASKS = "meta/tasks.parquet"
PICTURES = ("image", "video")  # dtypes of features that are no numbers
_INDEX_COLUMNS = ("index", "episode_index", "task_index")


def read_info(root: Path) -> dict[str, Any]:
    """The content of `meta/info.json`, of the right version and with every entry used here.

    Raises:
        DatasetError: It is missing, damaged or of another version, or lacks an entry, or the
            dataset has no frames.
    """
    info = read_description(root)
    _check_counts(root / INFO, info, "total_frames", "total_episodes")
    return info


def read_description(root: Path) -> dict[str, Any]:
    """The same of a dataset that may be without frames as yet."""
    path = root / INFO
    if not root.is_dir():
        raise DatasetError(f"expected the folder of a LeRobot dataset, found no folder {root}")
    if not path.is_file():
        raise DatasetError(f"{root} is no LeRobot dataset: it has no meta/info.json")
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(f"{path} cannot be read: {error}") from error
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version != FORMAT_VERSION:
        raise DatasetError(f"{path}: expected codebase_version {FORMAT_VERSION}, found {version}")
    if not isinstance(info.get("features"), dict):
        raise DatasetError(f"{path}: expected the dataset's features, found {info.get('features')}")
    _check_counts(path, info, "fps")
    return info


def _check_counts(path: Path, info: dict[str, Any], *names: str) -> None:
    for name in names:
        count = info.get(name)
        number = 0 if isinstance(count, bool) or not isinstance(count, int | float) else count
        if not 0 < number <= sys.float_info.max:
            raise DatasetError(f"{path}: expected {name} above 0 and finite, found {count!r}")


def told_names(description: Mapping[str, Any]) -> list[str] | None:
    """The names of a feature's dimensions, where `meta/info.json` has one for each.

    Some robots' datasets keep them by kind of part, {"motors": ["shoulder", ...]}, and some
    teleoperators' with their places, {"delta_x": 0, ...}.
    """
    names = description.get("names")
    if isinstance(names, dict):
        if all(isinstance(place, int) for place in names.values()):
            names = sorted(names, key=names.__getitem__)
        else:
            names = next(iter(names.values()), None)
    if not isinstance(names, list) or [len(names)] != description.get("shape"):
        return None
    return [str(name) for name in names]


def read_frames(
    root: Path, dimensions: Mapping[str, int], total_frames: float
) -> dict[str, np.ndarray]:
    """The index columns [N] and the features [N, D] of all data files, ordered by `index`.

    Args:
        root: The dataset's folder.
        dimensions: Feature -> D.
        total_frames: N, which is compared with what the files say before any frame is read.

    Raises:
        DatasetError: N or D is another in the files, or they hold something else than numbers.
    """
    paths = sorted((root / "data").glob("*/*.parquet"))
    if not paths:
        raise DatasetError(f"{root} has no data: expected data/chunk-*/file-*.parquet, found none")
    found = sum(map(count_rows, paths))
    if found != total_frames:
        raise DatasetError(
            f"meta/info.json counts {total_frames} frames, the data files hold {found}"
        )
    wanted = {**dict.fromkeys(_INDEX_COLUMNS, 1), **dimensions}
    files = [_read_frames(path, wanted) for path in paths]
    frames = {name: np.concatenate([file[name] for file in files]) for name in files[0]}
    order = np.argsort(frames["index"][:, 0], kind="stable")
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        return {
            name: rows[order].astype(np.float32) if name in dimensions else rows[order, 0]
            for name, rows in frames.items()
        }


def _read_frames(path: Path, dimensions: Mapping[str, int]) -> dict[str, np.ndarray]:
    columns = read_columns(path, dimensions)
    return columns | {name: integers(path, name, columns[name]) for name in _INDEX_COLUMNS}


def read_tasks(root: Path, task_indices: np.ndarray) -> list[str]:
    """The tasks of these numbers, in words."""
    tasks = read_all_tasks(root)
    unknown = sorted(set(task_indices.tolist()) - set(tasks))
    if unknown:
        raise DatasetError(f"{root / TASKS}: expected the tasks {unknown}, found {sorted(tasks)}")
    return [tasks[number] for number in task_indices.tolist()]


def read_all_tasks(root: Path) -> dict[int, str]:
    """Number of a task -> words; what their column is called depends on who wrote it."""
    path = root / TASKS
    table = read_parquet(path)
    words = [name for name in table.column_names if name != "task_index"]
    if len(table.column_names) != 2 or len(words) != 1:
        raise DatasetError(f"{path}: expected task_index and a task, found {table.column_names}")
    rows = list(zip(*(table[name].to_pylist() for name in ("task_index", *words)), strict=True))
    for number, task in rows:
        if type(number) is not int or not isinstance(task, str):
            raise DatasetError(
                f"{path}: expected tasks as number, words, found {number!r}, {task!r}"
            )
    return dict(rows)
