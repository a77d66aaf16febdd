"""Parquet files and Arrow columns, to and from numpy arrays; vectors `[1]` are stored as scalars.

Conversion goes by way of buffers and DLPack: Arrow's own functions import pandas where it is
installed, which takes 0.6 s. Files are checked before their content takes memory.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyarrow import types

from pacnet.datasets.format import DatasetError, unreadable

_MAX_ROWS_PER_BYTE = 100  # index columns alone, as deltas in zstd, come to 10
_MAX_INTEGER = 2**53  # of counts and indices


def to_arrow(rows: NDArray[np.generic]) -> pa.Array:
    """Return a column of vectors, from floats, integers or booleans `[N, D]`."""
    boolean = rows.dtype == np.bool_
    buffer = np.packbits(rows.astype(np.bool_), bitorder="little") if boolean else rows
    kind = pa.bool_() if boolean else pa.type_for_alias(str(rows.dtype))
    flat = pa.Array.from_buffers(kind, rows.size, [None, pa.py_buffer(buffer)])
    dimension = rows.shape[1]
    return flat if dimension == 1 else pa.FixedSizeListArray.from_arrays(flat, dimension)


def to_arrow_lists(values: pa.Array, length: int) -> pa.Array:
    """Return a column of lists of this length, which hold the values in their order."""
    offsets = np.arange(0, len(values) + 1, length, dtype=np.int32)
    return pa.ListArray.from_arrays(to_arrow(offsets[:, None]), values)


def to_arrow_text(texts: Sequence[str]) -> pa.Array:
    """Return a column of text."""
    encoded = [text.encode() for text in texts]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    buffers = [None, pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(texts), buffers)


def to_arrow_bytes(contents: Sequence[bytes]) -> pa.Array:
    """Return a column of bytes, which may have more than 2 GB together."""
    offsets = np.cumsum([0, *map(len, contents)], dtype=np.int64)
    buffers = [None, pa.py_buffer(offsets), pa.py_buffer(b"".join(contents))]
    return pa.Array.from_buffers(pa.large_binary(), len(contents), buffers)


def is_list(kind: pa.DataType) -> bool:
    """Return whether values of a type are lists, of fixed length or not."""
    return types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)


def dimension_of(column: pa.ChunkedArray) -> int:
    """Return the number of dimensions of a column's vectors, as its first one has it."""
    kind = column.type
    if types.is_fixed_size_list(kind):
        return kind.list_size
    if not is_list(kind) or len(column.drop_null()) == 0:
        return 1
    return len(column.drop_null()[0])


def to_numpy(column: pa.ChunkedArray, dimension: int, *, gaps: bool = False) -> NDArray[np.generic]:
    """Return a column of numbers as vectors `[N, D]`; booleans become 0 and 1.

    With `gaps`, floats that are empty and empty vectors of floats become NaN.

    Raises:
        ValueError: it holds something else; the message only describes that.
    """
    whole = values = column.combine_chunks()
    gaps = gaps and types.is_floating(
        values.type.value_type if is_list(values.type) else values.type
    )
    if gaps:
        values = values.drop_null()
    if dimension > 1 or types.is_nested(values.type):
        if not is_list(values.type):
            raise ValueError(f"{values.type} in place of lists of {dimension}")
        lengths = _to_numpy_flat(pc.call_function("list_value_length", [values]))
        if (lengths != dimension).any():
            raise ValueError(
                f"{lengths[lengths != dimension][0]} in a frame in place of {dimension}"
            )
        values = values.flatten()
    if gaps and values.null_count:
        values = pc.call_function("coalesce", [values, pa.scalar(math.nan, values.type)])
    rows = _to_numpy_flat(values).reshape(-1, dimension)
    if len(rows) == len(whole):
        return rows
    filled = np.full((len(whole), dimension), np.nan, rows.dtype)
    filled[_to_numpy_flat(whole.is_valid()) == 1] = rows
    return filled


def _to_numpy_flat(values: pa.Array) -> NDArray[np.generic]:
    if values.null_count:
        raise ValueError(f"{values.null_count} gaps")
    if types.is_boolean(values.type):
        values = values.cast(pa.uint8())
    if not (types.is_integer(values.type) or types.is_floating(values.type)):
        raise ValueError(f"values of type {values.type}")
    return np.from_dlpack(values)


@contextmanager
def open_parquet(path: Path, columns: Sequence[str] = ()) -> Iterator[pq.ParquetFile]:
    """Open a Parquet file with these columns; raise a DatasetError if the block cannot read it."""
    try:
        if not path.is_file():
            raise OSError("it is no file" if path.exists() else "there is no such file")
        with pq.ParquetFile(path) as file:
            _check(path, file, columns)
            yield file
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        raise unreadable(path, error) from error


def _check(path: Path, file: pq.ParquetFile, columns: Sequence[str]) -> None:
    names, metadata, size = file.schema_arrow.names, file.metadata, path.stat().st_size
    if len(set(names)) < len(names):
        raise DatasetError(f"{path}: expected columns of different names, found {names}")
    missing = [name for name in columns if name not in names]
    if missing:
        raise DatasetError(f"{path}: expected the columns {missing}, found {names}")
    groups = [metadata.row_group(index).num_rows for index in range(metadata.num_row_groups)]
    n_rows = metadata.num_rows
    if sum(groups) != n_rows or min(groups, default=0) < 0:
        raise DatasetError(f"{path}: expected {n_rows} rows in all, found {sum(groups)}")
    if n_rows > _MAX_ROWS_PER_BYTE * size:
        raise DatasetError(f"{path}: expected rows that fit, found {n_rows} in {size} bytes")


def count_rows(path: Path) -> int:
    """Return the number of rows in a file without reading them."""
    with open_parquet(path) as file:
        return file.metadata.num_rows


def read_table(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Read the named columns of a Parquet file, or all of them."""
    with open_parquet(path, columns or ()) as file:
        return file.read(columns)


def read_columns(path: Path, dimensions: Mapping[str, int]) -> dict[str, NDArray[np.generic]]:
    """Read columns of numbers: name -> D gives name -> `[N, D]`."""
    table = read_table(path, [*dimensions])
    return {
        name: numbers_of(path, name, table[name], dimension)
        for name, dimension in dimensions.items()
    }


def numbers_of(
    path: Path, name: str, column: pa.ChunkedArray, dimension: int, *, gaps: bool = False
) -> NDArray[np.generic]:
    """Return a column of a file as `to_numpy` does; raise a DatasetError that names both."""
    try:
        return to_numpy(column, dimension, gaps=gaps)
    except (ValueError, pa.ArrowException) as error:
        raise DatasetError(f"{path}: expected numbers in {name!r}, found {error}") from None


def as_indices(path: Path, name: str, rows: NDArray[Any]) -> NDArray[np.int64]:
    """Return a column of counts or indices as int64, after checking that it holds such."""
    if rows.dtype.kind not in "iu":
        raise DatasetError(f"{path}: expected integers in {name!r}, found {rows.dtype}")
    invalid = (rows < 0) | (rows > _MAX_INTEGER)
    if invalid.any():
        raise DatasetError(
            f"{path}: expected integers from 0 to 2**53 in {name!r}, found {rows[invalid][0]}"
        )
    return rows.astype(np.int64)
