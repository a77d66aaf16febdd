"""Columns of several axes: numbers `[N, ...]` out of nested lists, and nested lists of numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pacnet.datasets.format.parquet import is_list, to_arrow, to_arrow_lists, to_numpy


def to_rows(column: pa.ChunkedArray, shape: Sequence[int]) -> NDArray[np.generic]:
    """Return a column of numbers of this shape as `[N, ...]`.

    Raises:
        ValueError: it holds something else; the message only describes that.
    """
    n_rows, values = len(column), column.combine_chunks()
    for size in shape[:-1]:
        if not is_list(values.type) or values.null_count:
            raise ValueError(f"{values.type} with {values.null_count} gaps in place of lists")
        lengths = pc.call_function("list_value_length", [values])
        if not pc.call_function("all", [pc.call_function("equal", [lengths, size])]).as_py():
            raise ValueError(f"lists of other lengths than {size}")
        values = values.flatten()
    return to_numpy(pa.chunked_array([values]), shape[-1]).reshape(n_rows, *shape)


def as_scalars(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column of lists of one value as these values."""
    chunks = [chunk.flatten() for chunk in column.chunks]
    return pa.chunked_array(chunks, column.type.value_type)


def nested_column(values: Sequence[Any], axes: int, dtype: str = "float64") -> pa.Array:
    """Return a column of lists, nested as often as there are axes, from `[...]` each or None."""
    there = [np.asarray(value, dtype=dtype) for value in values if value is not None]
    if not there:
        kind = pa.type_for_alias(dtype)
        for _ in range(axes):
            kind = pa.list_(kind)
        return pa.nulls(len(values), kind)
    rows = np.stack(there)
    column = to_arrow(rows.reshape(-1, 1))
    for size in rows.shape[:1:-1]:
        column = to_arrow_lists(column, size)
    ends = np.cumsum([0, *(rows.shape[1] * (value is not None) for value in values)])
    gaps = pa.array([value is None for value in values], pa.bool_())
    return pa.ListArray.from_arrays(to_arrow(ends.astype(np.int32)[:, None]), column, mask=gaps)
