"""Columns between numpy and Arrow; vectors of length 1 are stored as scalars.

By way of buffers and DLPack: Arrow's own conversions import pandas, for 0.6 s, where there is one.
"""

from collections.abc import Iterable, Sequence
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


def to_numpy(chunks: Iterable["pa.Array"]) -> NDArray[np.generic]:
    """The vectors [N, D] of a column's chunks, at least one, without gaps; booleans as 0 and 1."""
    return np.concatenate([_chunk_to_numpy(chunk) for chunk in chunks])


def _chunk_to_numpy(chunk: "pa.Array") -> NDArray[np.generic]:
    import pyarrow as pa

    length = len(chunk)
    flat = chunk.flatten() if pa.types.is_nested(chunk.type) else chunk
    if pa.types.is_boolean(flat.type):
        flat = flat.cast(pa.uint8())
    return np.from_dlpack(flat).reshape(length, -1)
