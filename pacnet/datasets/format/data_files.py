"""The data files of a dataset: the columns asked for, and which files cannot be read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import types

from pacnet.datasets.format import DatasetError, MissingFeature
from pacnet.datasets.format.episode_list import episode_of_old_file
from pacnet.datasets.format.parquet import (
    as_indices,
    dimension_of,
    numbers_of,
    open_parquet,
    to_numpy,
)

EPISODE, TASK, INDEX, FRAME, TIME = (
    "episode_index", "task_index", "index", "frame_index", "timestamp",
)  # fmt: skip
ROW = "row"  # of all data files, one after the other
_INDICES = (EPISODE, TASK, INDEX, FRAME)

Columns = dict[str, NDArray[Any]]
"""Indices `[N]`, `timestamp` `[N]` in s, and features `[N, D]`."""


class DataFiles(NamedTuple):
    """What was read of all data files."""

    columns: Columns  # of all that can be read, one file after the other
    lengths: dict[Path, int]  # their numbers of rows
    damaged: dict[Path, DatasetError]  # those that cannot be read


def data_paths(root: Path) -> list[Path]:
    """Return the data files of a dataset, at least one."""
    paths = sorted((root / "data").glob("*/[!.]*.parquet"))  # "._x" is of other systems
    if not paths:
        raise DatasetError(f"{root} has no data: expected data/chunk-*/*.parquet, found none")
    return paths


def read_data_files(root: Path, features: Sequence[str]) -> DataFiles:
    """Read the index columns that there are, the time, and these features.

    Raises:
        DatasetError: no data file, or none that can be read.
        MissingFeature: a feature that no data file has.
    """
    files: dict[Path, Columns] = {}
    damaged: dict[Path, DatasetError] = {}
    dimensions: dict[str, int] = {}
    for path in data_paths(root):
        try:
            files[path] = read_data_file(path, features, dimensions)
        except DatasetError as error:
            damaged[path] = error
    if not files:
        raise next(iter(damaged.values()))
    lengths = {path: len(columns[EPISODE]) for path, columns in files.items()}
    first, *rest = files.values()
    if not rest:  # without a copy
        return DataFiles(first, lengths, damaged)
    names = [name for name in first if all(name in columns for columns in rest)]
    joined = {name: np.concatenate([first[name], *(one[name] for one in rest)]) for name in names}
    return DataFiles(joined, lengths, damaged)


def read_data_file(path: Path, features: Sequence[str], dimensions: dict[str, int]) -> Columns:
    """Read one file; `dimensions` are those of the files before, and are completed."""
    with open_parquet(path) as file:
        there = file.schema_arrow.names
        missing = [name for name in features if name not in there]
        if missing:
            raise MissingFeature(
                f"{path}: expected the columns {missing}, found {there}", tuple(missing)
            )
        extra = [name for name in (*_INDICES, TIME) if name in there]
        table = file.read([*dict.fromkeys([*features, *extra])])
    columns = {name: _feature(path, name, table[name], dimensions) for name in features}
    for name in extra:
        column = table[name]
        if name != TIME:
            columns[name] = as_indices(path, name, numbers_of(path, name, column, 1)[:, 0])
        elif (times := _time(column)) is not None:
            columns[name] = times
    if EPISODE not in columns:
        episode = episode_of_old_file(path)
        if episode is None:
            raise DatasetError(f"{path}: expected the column {EPISODE!r}, found {there}")
        columns[EPISODE] = np.full(len(table), episode)
    return columns


def _feature(
    path: Path, name: str, column: pa.ChunkedArray, dimensions: dict[str, int]
) -> NDArray[Any]:
    """Return a feature `[N, D]`, with D as in the files before."""
    dimension = dimensions.get(name, 0) or dimension_of(column)
    if not dimension:
        raise DatasetError(
            f"{path}: expected numbers in {name!r}, found vectors without dimensions"
        )
    rows = numbers_of(path, name, column, dimension, gaps=True)
    dimensions[name] = dimension
    return rows


def _time(column: pa.ChunkedArray) -> NDArray[Any] | None:
    """Return the time of each frame [s], as float32 if it is stored so; None if it is no number."""
    try:
        if types.is_timestamp(column.type):
            nanoseconds = column.cast(pa.timestamp("ns"), safe=False).cast(pa.int64())
            return to_numpy(nanoseconds, 1)[:, 0].astype(np.float64) / 1e9
        rows = to_numpy(column, 1)[:, 0]
    except (ValueError, pa.ArrowException):
        return None
    return rows if rows.dtype == np.float32 else rows.astype(np.float64)


def columns_of(root: Path) -> Mapping[str, pa.DataType]:
    """Return the columns of the first data file that can be read, with their types."""
    damaged: list[DatasetError] = []
    for path in data_paths(root):
        try:
            with open_parquet(path) as file:
                return dict(zip(file.schema_arrow.names, file.schema_arrow.types, strict=True))
        except DatasetError as error:
            damaged.append(error)
    raise damaged[0]
