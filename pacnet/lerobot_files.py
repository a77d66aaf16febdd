"""The files of a LeRobot dataset (format v3.0), checked, as plain Python and numpy.

Of the format's files three kinds are read: `meta/info.json` describes the features and counts the
frames, `meta/tasks.parquet` names the tasks, and `data/chunk-*/file-*.parquet` hold one row per
frame, many episodes a file. Images and videos are left alone. Needs pyarrow.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT_VERSION = "v3.0"
PICTURES = ("image", "video")  # dtypes of features that are no numbers
_INDEX_COLUMNS = ("index", "episode_index", "task_index")


class DatasetError(ValueError):
    """A dataset that cannot be read as demonstrations; the message says what is wrong with it."""


def read_info(root: Path) -> dict[str, Any]:
    """The content of `meta/info.json`, of the right version and with every entry used here."""
    path = root / "meta" / "info.json"
    if not root.is_dir():
        raise DatasetError(f"expected the folder of a LeRobot dataset, found no folder {root}")
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DatasetError(f"{root} is no LeRobot dataset: it has no meta/info.json") from None
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read: {error}") from error
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if version != FORMAT_VERSION:
        raise DatasetError(f"{path}: expected codebase_version {FORMAT_VERSION}, found {version}")
    _check_info(path, info)
    return info


def _check_info(path: Path, info: dict[str, Any]) -> None:
    """Refuse an info.json without the entries that are used here."""
    if not isinstance(info.get("features"), dict):
        raise DatasetError(f"{path}: expected the dataset's features, found {info.get('features')}")
    for name in ("fps", "total_frames", "total_episodes"):
        count = info.get(name)
        number = 0 if isinstance(count, bool) or not isinstance(count, int | float) else count
        if not 0 < number < math.inf:
            raise DatasetError(f"{path}: expected {name} above 0 and finite, found {count!r}")


def read_frames(root: Path, dimensions: Mapping[str, int]) -> dict[str, np.ndarray]:
    """The index columns [N] and the features [N, D] of all data files, ordered by `index`."""
    paths = sorted((root / "data").glob("*/*.parquet"))
    if not paths:
        raise DatasetError(f"{root} has no data: expected data/chunk-*/file-*.parquet, found none")
    files = [_read_data_file(path, dimensions) for path in paths]
    frames = {name: np.concatenate([file[name] for file in files]) for name in files[0]}
    order = np.argsort(frames["index"], kind="stable")
    return {name: column[order] for name, column in frames.items()}


def read_tasks(root: Path, task_indices: np.ndarray) -> list[str]:
    """The tasks in words; what the column of the words is called depends on who wrote it."""
    path = root / "meta" / "tasks.parquet"
    table = read_parquet(path)
    words = [name for name in table.column_names if name != "task_index"]
    if len(table.column_names) != 2 or len(words) != 1:
        raise DatasetError(f"{path}: expected task_index and a task, found {table.column_names}")
    rows = list(zip(*(table[name].to_pylist() for name in ("task_index", *words)), strict=True))
    for number, task in rows:
        if not isinstance(number, int) or not isinstance(task, str):
            raise DatasetError(
                f"{path}: expected tasks as number, words, found {number!r}, {task!r}"
            )
    tasks = dict(rows)
    unknown = sorted(set(task_indices.tolist()) - set(tasks))
    if unknown:
        raise DatasetError(f"{path}: expected the tasks {unknown}, found {sorted(tasks)}")
    return [tasks[number] for number in task_indices.tolist()]


def _read_data_file(path: Path, dimensions: Mapping[str, int]) -> dict[str, np.ndarray]:
    """The index columns [N] and the features [N, D] of one data file."""
    table = read_parquet(path, [*_INDEX_COLUMNS, *dimensions])
    columns = {}
    for name in table.column_names:
        column = table[name].combine_chunks()
        try:
            if name in dimensions:
                columns[name] = _to_matrix(column, dimensions[name])
            else:
                columns[name] = _to_numpy(column)
        except ValueError as error:
            raise DatasetError(f"{path}: expected numbers in {name!r}, found {error}") from None
    return columns


def read_parquet(path: Path, columns: Sequence[str] | None = None) -> "pa.Table":
    """The named columns of a Parquet file, or all of them."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            there = file.schema_arrow.names
            missing = [name for name in columns or () if name not in there]
            if missing:
                raise DatasetError(f"{path}: expected the columns {missing}, found {there}")
            return file.read(columns)
    except (OSError, pa.ArrowException) as error:
        raise DatasetError(f"{path} cannot be read: {error}") from error


def _to_matrix(column: "pa.Array", dimension: int) -> np.ndarray:
    """A column of vectors as float32 [N, D]; vectors of length 1 are stored as scalars."""
    import pyarrow.compute as pc
    import pyarrow.types

    if dimension > 1 or pyarrow.types.is_nested(column.type):
        if not _is_list(column.type):
            raise ValueError(f"{column.type} in place of lists of {dimension}")
        lengths = _to_numpy(pc.call_function("list_value_length", [column]))
        if (lengths != dimension).any():
            raise ValueError(
                f"{lengths[lengths != dimension][0]} in a frame in place of {dimension}"
            )
        column = column.flatten()
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        return _to_numpy(column).astype(np.float32).reshape(-1, dimension)


def _is_list(kind: "pa.DataType") -> bool:
    from pyarrow import types

    return types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)


def _to_numpy(column: "pa.Array") -> np.ndarray:
    """A column of numbers; by way of DLPack, as `to_numpy` imports pandas for 0.6 s."""
    import pyarrow.types

    if column.null_count:
        raise ValueError(f"{column.null_count} gaps")
    if pyarrow.types.is_boolean(column.type):
        column = column.cast(pyarrow.uint8())
    if not (pyarrow.types.is_integer(column.type) or pyarrow.types.is_floating(column.type)):
        raise ValueError(f"values of type {column.type}")
    return np.from_dlpack(column)
