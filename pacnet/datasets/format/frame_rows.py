"""Rows of data files, read an episode at a time without reading a whole file twice."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacnet.datasets.format.parquet import open_parquet


class Rows(NamedTuple):
    """Rows of a data file, in the order of their frames."""

    path: Path
    rows: NDArray[np.int64]


class FrameReader:
    """Reads episodes; it remembers the row groups that it read last, where the next may begin."""

    def __init__(self, columns: Sequence[str]) -> None:
        """Name the columns to read."""
        self._columns = [*columns]
        self._path: Path | None = None
        self._groups = range(0)
        self._read = pa.table({})
        self._first = 0  # row of the file at which these groups begin

    def frames(self, parts: Sequence[Rows]) -> pa.Table:
        """Return the columns of an episode, extension types as what they are stored as."""
        return pa.concat_tables([self._rows(part) for part in parts])

    def _rows(self, part: Rows) -> pa.Table:
        first, last = int(part.rows.min()), int(part.rows.max())
        with open_parquet(part.path, self._columns) as file:
            starts = _group_starts(file.metadata)
            groups = range(
                int(np.searchsorted(starts, first, "right")) - 1,
                int(np.searchsorted(starts, last, "right")),
            )
            if (part.path, groups) != (self._path, self._groups):
                self._read = pa.table({})  # before more memory is taken
                self._read = _plain(file.read_row_groups([*groups], self._columns))
                self._path, self._groups, self._first = part.path, groups, int(starts[groups[0]])
        rows = part.rows - self._first
        if len(rows) == last - first + 1 and (np.diff(rows) == 1).all():
            return self._read.slice(first - self._first, len(rows))
        return self._read.take(rows)


def _group_starts(metadata: pq.FileMetaData) -> NDArray[np.int64]:
    """Return the row at which each row group begins."""
    counts = [metadata.row_group(index).num_rows for index in range(metadata.num_row_groups)]
    return np.cumsum([0, *counts])[:-1]


def _plain(table: pa.Table) -> pa.Table:
    """Return a table without metadata of others, of Arrow's own types."""
    columns = [
        pa.chunked_array([chunk.storage for chunk in column.chunks], column.type.storage_type)
        if isinstance(column.type, pa.BaseExtensionType)
        else column
        for column in table.columns
    ]
    return pa.table(columns, names=table.column_names)
