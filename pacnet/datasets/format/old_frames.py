"""Whether a dataset's old frames can be read together with new ones, told without reading them.

Parquet counts the values and the gaps of each column, and `meta/episodes` has the extremes of each
episode, which are not finite where a value is not.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pacnet.datasets.format.arrow_columns import is_list, to_numpy
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.files import Dataset
from pacnet.datasets.format.parquet_files import opened, read_parquet

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq


def check_frames(root: Path, dataset: Dataset) -> None:
    """Refuse a dataset whose frames cannot be read as its features.

    Raises:
        DatasetError: A file lacks a feature, or holds something else, gaps or, as its episodes'
            statistics say, numbers that are not finite.
    """
    features = dataset.info["features"]
    dimensions = {name: told["shape"][0] for name, told in features.items()}
    for number in dataset.frame_files:
        _check_file(dataset.frames_path(root, number), dimensions)
    for path in sorted((root / "meta" / "episodes").glob("*/*.parquet")):
        _check_extremes(path, features)


def check_orphans(root: Path, dataset: Dataset, written: Iterable[str]) -> None:
    """Refuse files of frames that belong to no episode, which readers would take for some.

    Args:
        root: The dataset's folder.
        dataset: What is there.
        written: Places of files that are written, and may replace such ones.

    Raises:
        DatasetError: There is one.
    """
    places = {*map(dataset.frames_place, dataset.frame_files), *written}
    known = {root / place for place in places}
    for path in sorted((root / "data").glob("*/*.parquet")):
        if path not in known:
            raise DatasetError(f"{path} holds frames of no episode: move it away")


def _check_file(path: Path, dimensions: Mapping[str, int]) -> None:
    import pyarrow as pa

    with opened(path) as file:
        nothing, told = file.schema_arrow.empty_table(), file.metadata
    missing = [name for name in dimensions if name not in nothing.column_names]
    if missing:
        raise DatasetError(f"{path}: expected the columns {missing}, found {nothing.column_names}")
    for name, dimension in dimensions.items():
        try:
            to_numpy(nothing[name], dimension)
            for chunk in _chunks(told, name):
                _check_chunk(*chunk, dimension)
        except (ValueError, pa.ArrowException) as error:
            raise DatasetError(f"{path}: expected numbers in {name!r}, found {error}") from None


def _chunks(told: "pq.FileMetaData", name: str) -> Iterator[tuple[int, "pq.ColumnChunkMetaData"]]:
    """A column in each row group, after the number of rows; that of a list is its elements'."""
    for group in map(told.row_group, range(told.num_row_groups)):
        for column in map(group.column, range(group.num_columns)):
            path = column.path_in_schema
            if path == name or path.startswith(f"{name}.list."):
                yield group.num_rows, column


def _check_chunk(rows: int, column: "pq.ColumnChunkMetaData", dimension: int) -> None:
    told = column.statistics
    if told is not None and told.null_count:
        raise ValueError(f"{told.null_count} gaps")
    if column.num_values != rows * dimension:
        raise ValueError(f"{column.num_values} in {rows} frames in place of {dimension} in each")


def _check_extremes(path: Path, features: Iterable[str]) -> None:
    with opened(path) as file:
        there = file.schema_arrow.names
    names = {f"stats/{feature}/{name}": feature for feature in features for name in ("min", "max")}
    table = read_parquet(path, ["episode_index", *(name for name in names if name in there)])
    for name in table.column_names[1:]:
        rows = table[name]
        if not _is_finite(rows):
            row = next(row for row in range(len(rows)) if not _is_finite(rows.slice(row, 1)))
            raise DatasetError(
                f"{path}: expected finite numbers in {names[name]!r}, found others in episode "
                f"{table['episode_index'][row]}"
            )


def _is_finite(column: "pa.ChunkedArray") -> bool:
    """Whether all numbers in lists are, of whatever depth; an episode may be without any."""
    import pyarrow.types

    values = column.combine_chunks()
    while is_list(values.type):
        values = values.flatten()
    if not pyarrow.types.is_floating(values.type):
        return True
    return bool(np.isfinite(np.from_dlpack(values.drop_null())).all())
