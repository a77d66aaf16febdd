"""Columns between numpy and Arrow; vectors of length 1 are stored as scalars.

By way of buffers and DLPack: Arrow's own conversions import pandas, for 0.6 s, where there is one.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyarrow as pa


def to_arrow(rows: NDArray[np.generic]) -> "pa.Array":
    """A column of vectors [N, D] of floats, integers or booleans."""
    import pyarrow as pa

    boolean = rows.dtype == np.bool_
    buffer = np.packbits(rows.astype(np.bool_), bitorder="little") if boolean else rows
    kind = pa.bool_() if boolean else pa.type_for_alias(str(rows.dtype))
    flat = pa.Array.from_buffers(kind, rows.size, [None, pa.py_buffer(buffer)])
    dimension = rows.shape[1]
    return flat if dimension == 1 else pa.FixedSizeListArray.from_arrays(flat, dimension)


def to_arrow_lists(rows: NDArray[np.generic]) -> "pa.Array":
    """A column of lists of numbers, [N, D], those of length 1 as lists as well."""
    import pyarrow as pa

    offsets = np.arange(len(rows) + 1, dtype=np.int32) * rows.shape[1]
    return pa.ListArray.from_arrays(to_arrow(offsets[:, None]), to_arrow(rows.reshape(-1, 1)))


def to_arrow_words(words: Sequence[str]) -> "pa.Array":
    """A column of text."""
    import pyarrow as pa

    encoded = [word.encode() for word in words]
    offsets = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    buffers = [None, pa.py_buffer(offsets), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(words), buffers)


def is_list(kind: "pa.DataType") -> bool:
    """Whether its values are lists, of whatever lengths."""
    from pyarrow import types

    return types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)


def to_numpy(column: "pa.ChunkedArray", dimension: int) -> NDArray[np.generic]:
    """A column of numbers as vectors [N, D]; booleans as 0 and 1.

    Raises:
        ValueError: It holds something else; the message says what was found.
    """
    import pyarrow.compute as pc
    import pyarrow.types

    values = column.combine_chunks()
    if dimension > 1 or pyarrow.types.is_nested(values.type):
        if not is_list(values.type):
            raise ValueError(f"{values.type} in place of lists of {dimension}")
        lengths = _numbers(pc.call_function("list_value_length", [values]))
        if (lengths != dimension).any():
            raise ValueError(
                f"{lengths[lengths != dimension][0]} in a frame in place of {dimension}"
            )
        values = values.flatten()
    return _numbers(values).reshape(-1, dimension)


def _numbers(values: "pa.Array") -> NDArray[np.generic]:
    import pyarrow.types

    if values.null_count:
        raise ValueError(f"{values.null_count} gaps")
    if pyarrow.types.is_boolean(values.type):
        values = values.cast(pyarrow.uint8())
    if not (pyarrow.types.is_integer(values.type) or pyarrow.types.is_floating(values.type)):
        raise ValueError(f"values of type {values.type}")
    return np.from_dlpack(values)
