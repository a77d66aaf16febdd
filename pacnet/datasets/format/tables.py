"""The tables of `meta/`, laid out as LeRobot's readers expect them: tasks and episodes."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pacnet.datasets.format import DatasetError, unreadable
from pacnet.datasets.format.parquet import (
    open_parquet,
    read_table,
    to_arrow,
    to_arrow_lists,
    to_arrow_text,
)

TASKS = "meta/tasks.parquet"
OLD_TASKS, OLD_EPISODES = "meta/tasks.jsonl", "meta/episodes.jsonl"  # of formats v2.0 and v2.1


def read_tasks(root: Path) -> dict[int, str]:
    """Read the tasks by their indices; the column of their texts may have any name."""
    path = root / TASKS
    if not path.exists() and any((root / name).exists() for name in (OLD_TASKS, OLD_EPISODES)):
        return _read_old_tasks(root / OLD_TASKS)
    table = read_table(path)
    columns = [name for name in table.column_names if name != "task_index"]
    if len(table.column_names) != 2 or len(columns) != 1:
        raise DatasetError(f"{path}: expected task_index and a task, found {table.column_names}")
    rows = zip(*(table[name].to_pylist() for name in ("task_index", *columns)), strict=True)
    return _checked_tasks(path, rows)


def _read_old_tasks(path: Path) -> dict[int, str]:
    """Read the tasks of formats v2.0 and v2.1."""
    lines = read_json_lines(path)
    return _checked_tasks(path, ((line.get("task_index"), line.get("task")) for line in lines))


def _checked_tasks(path: Path, rows: Iterable[tuple[Any, ...]]) -> dict[int, str]:
    tasks: dict[int, str] = {}
    for index, task in rows:
        if type(index) is not int or not isinstance(task, str):
            raise DatasetError(f"{path}: expected tasks as index, text, found {index!r}, {task!r}")
        tasks[index] = task
    return tasks


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """Read a file with an object of JSON on each line."""
    try:
        if path.exists() and not path.is_file():
            raise OSError("it is no file")
        text = path.read_text(encoding="utf-8")
        lines = [json.loads(line) for line in text.splitlines() if line.strip()]
    except (OSError, ValueError, RecursionError) as error:
        raise unreadable(path, error) from error
    for line in lines:
        if not isinstance(line, dict):
            raise DatasetError(f"{path}: expected an object on each line, found {line!r}")
    return lines


def episode_files(root: Path) -> list[Path]:
    """Return the files of `meta/episodes`, in their order."""
    return sorted((root / "meta" / "episodes").glob("*/*.parquet"))


def read_episode_rows(root: Path, columns: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the rows of `meta/episodes`: the episode's index, and these columns where there."""
    for path in episode_files(root):
        with open_parquet(path, ["episode_index"]) as file:
            there = [name for name in columns if name in file.schema_arrow.names]
            yield from file.read(["episode_index", *there]).to_pylist()


def tasks_table(tasks: Sequence[str]) -> pa.Table:
    """Return the tasks as pandas writes a frame with them as its index, which LeRobot expects."""
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored}
        for name, kind, stored in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]
    layout = {
        "index_columns": ["task"],
        "column_indexes": [{"name": None, "pandas_type": "unicode", "numpy_type": "object"}],
        "columns": [column | {"metadata": None} for column in columns],
        "pandas_version": "2.0.0",
    }
    indices = to_arrow(np.arange(len(tasks), dtype=np.int64)[:, None])
    return pa.table(
        {"task_index": indices, "task": to_arrow_text(tasks)},
        metadata={b"pandas": json.dumps(layout).encode()},
    )


def episodes_table(rows: Sequence[Mapping[str, Any]], schema: pa.Schema | None) -> pa.Table:
    """Return the table of `meta/episodes`.

    Args:
        rows: for each episode, name of a column -> a number, a list of numbers, nested or not, or a
            list of one text.
        schema: columns of the dataset's older episodes: the new ones get the same, and gaps in
            those that are missing in `rows`.
    """
    columns = {name: _column([row[name] for row in rows]) for name in rows[0]}
    if schema is None:
        return pa.table(columns)
    aligned = [
        columns[field.name].cast(field.type)
        if field.name in columns
        else pa.nulls(len(rows), field.type)
        for field in schema
    ]
    return pa.table(aligned, names=schema.names)


def _column(values: Sequence[Any]) -> pa.Array:
    if isinstance(values[0], list) and isinstance(values[0][0], str):
        return to_arrow_lists(to_arrow_text([value[0] for value in values]), 1)
    rows = np.array(values)
    column = to_arrow(rows.reshape(-1, 1))
    for size in rows.shape[:0:-1]:
        column = to_arrow_lists(column, size)
    return column
