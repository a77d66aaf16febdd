"""What stands in the files of a dataset's `meta/`, laid out as LeRobot's readers want it."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pacnet.datasets.format.arrow_columns import to_arrow, to_arrow_lists, to_arrow_words

if TYPE_CHECKING:
    import pyarrow as pa


def json_bytes(content: Mapping[str, Any]) -> bytes:
    """A JSON file, indented as LeRobot has it; a ValueError for numbers that JSON has not."""
    return json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False).encode()


def tasks_table(tasks: Sequence[str]) -> "pa.Table":
    """The tasks as pandas writes a frame whose index they are: LeRobot looks them up in it."""
    import pyarrow as pa

    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored}
        for name, kind, stored in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]
    told = {
        "index_columns": ["task"],
        "column_indexes": [{"name": None, "pandas_type": "unicode", "numpy_type": "object"}],
        "columns": [column | {"metadata": None} for column in columns],
        "pandas_version": "2.0.0",
    }
    numbers = to_arrow(np.arange(len(tasks), dtype=np.int64)[:, None])
    return pa.table(
        {"task_index": numbers, "task": to_arrow_words(tasks)},
        metadata={b"pandas": json.dumps(told).encode()},
    )


def episodes_table(rows: Sequence[Mapping[str, Any]], schema: "pa.Schema | None") -> "pa.Table":
    """The episodes' descriptions.

    Args:
        rows: For each episode, name of a column -> an integer, a list of numbers, or a list of one
            text.
        schema: Columns of the dataset's older episodes, which the new ones then have as well: what
            they lack in them stays empty.
    """
    import pyarrow as pa

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


def _column(values: Sequence[Any]) -> "pa.Array":
    import pyarrow as pa

    if isinstance(values[0], int):
        return to_arrow(np.array(values, dtype=np.int64)[:, None])
    if isinstance(values[0][0], str):
        offsets = to_arrow(np.arange(len(values) + 1, dtype=np.int32)[:, None])
        return pa.ListArray.from_arrays(offsets, to_arrow_words([value[0] for value in values]))
    return to_arrow_lists(np.array(values))
