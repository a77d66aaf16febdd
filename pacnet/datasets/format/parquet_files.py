"""Parquet files, checked before what they hold takes memory, as Arrow tables and numpy columns."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format.arrow_columns import to_numpy
from pacnet.datasets.format.errors import DatasetError

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

_ROWS_A_BYTE = 100  # the most; even index columns alone, as deltas in zstd, come to 10
_LARGEST = 2**53  # of integers that count or number something


@contextmanager
def opened(path: Path) -> Iterator["pq.ParquetFile"]:
    """An open Parquet file, with an error that names it for all that is wrong with it.

    Raises:
        DatasetError: It cannot be read, has two columns of one name, or declares more rows than its
            size can hold; or reading it in the block fails.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        if path.exists() and not path.is_file():
            raise OSError("it is no file")
        with pq.ParquetFile(path) as file:
            _check(path, file)
            yield file
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        raise DatasetError(f"{path} cannot be read: {error}") from error


def _check(path: Path, file: "pq.ParquetFile") -> None:
    names, told, size = file.schema_arrow.names, file.metadata, path.stat().st_size
    if len(set(names)) < len(names):
        raise DatasetError(f"{path}: expected columns of different names, found {names}")
    groups = [told.row_group(number).num_rows for number in range(told.num_row_groups)]
    if sum(groups) != told.num_rows or min(groups, default=0) < 0:
        raise DatasetError(f"{path}: expected {told.num_rows} rows in all, found {sum(groups)}")
    if told.num_rows > _ROWS_A_BYTE * size:
        raise DatasetError(f"{path}: expected rows that fit, found {told.num_rows} in {size} bytes")


def count_rows(path: Path) -> int:
    """The number of rows in a file, which reads none of them."""
    with opened(path) as file:
        return file.metadata.num_rows


def read_columns(path: Path, dimensions: Mapping[str, int]) -> dict[str, NDArray[np.generic]]:
    """Columns of a Parquet file as vectors [N, D].

    Args:
        path: The file.
        dimensions: Name of a column -> D.

    Raises:
        DatasetError: The file cannot be read, or holds something else.
    """
    import pyarrow as pa

    table = read_parquet(path, [*dimensions])
    columns = {}
    for name, dimension in dimensions.items():
        try:
            columns[name] = to_numpy(table[name], dimension)
        except (ValueError, pa.ArrowException) as error:
            raise DatasetError(f"{path}: expected numbers in {name!r}, found {error}") from None
    return columns


def read_parquet(path: Path, columns: Sequence[str] | None = None) -> "pa.Table":
    """The named columns of a Parquet file, or all of them."""
    with opened(path) as file:
        there = file.schema_arrow.names
        missing = [name for name in columns or () if name not in there]
        if missing:
            raise DatasetError(f"{path}: expected the columns {missing}, found {there}")
        return file.read(columns)


def integers(path: Path, name: str, rows: NDArray[Any]) -> NDArray[np.int64]:
    """A column that counts or numbers something, as int64.

    Raises:
        DatasetError: It holds something else than integers from 0 on, or larger ones than ever are.
    """
    if rows.dtype.kind not in "iu":
        raise DatasetError(f"{path}: expected integers in {name!r}, found {rows.dtype}")
    strange = (rows < 0) | (rows > _LARGEST)
    if strange.any():
        raise DatasetError(
            f"{path}: expected integers from 0 to 2**53 in {name!r}, found {rows[strange][0]}"
        )
    return rows.astype(np.int64)
