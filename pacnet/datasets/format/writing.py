"""What a dataset's new files are made of: frames in data files, and an episode's row about them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacnet.core.durable import open_synced
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.parquet import to_arrow


class DataFiles(ExitStack):
    """Writer of new data files, one row group per episode; after a full one it starts another.

    So it does where an episode's columns are of other types than those before.
    """

    def __init__(
        self, info: Mapping[str, Any], first: FileNumber, place: Callable[[FileNumber], Path]
    ) -> None:
        """Begin with no file.

        Args:
            info: description of the dataset, with the sizes of files and chunks.
            first: number of the first new file.
            place: called with a file's number, returns where to write it.
        """
        super().__init__()
        self.paths: list[Path] = []  # written so far
        self._place, self._number = place, first
        self._chunks_size = info["chunks_size"]
        self._max_bytes = info["data_files_size_in_mb"] * 2**20
        self._file: IO[bytes] | None = None

    def add(self, table: pa.Table) -> FileNumber:
        """Append an episode and return the number of the file that it is in."""
        if self._file is not None and not self._takes(self._file, table):
            self.close()
            self._file = None
            self._number = self._number.next(self._chunks_size)
        if self._file is None:
            path = self._place(self._number)
            self.paths.append(path)
            self._file = self.enter_context(open_synced(path))
            self._writer = self.enter_context(
                pq.ParquetWriter(
                    self._file, table.schema, compression="snappy", use_dictionary=False
                )
            )
        self._writer.write_table(table)
        return self._number

    def _takes(self, file: IO[bytes], table: pa.Table) -> bool:
        fits = file.tell() + table.nbytes <= self._max_bytes
        return fits and table.schema.equals(self._writer.schema)


def with_index_columns(
    table: pa.Table, fps: float, start: int, episode: int, tasks: int | NDArray[np.int64]
) -> pa.Table:
    """Return an episode's features and the index columns.

    Args:
        table: the features.
        fps: frames per second [1/s].
        start: index of the episode's first frame.
        episode: index of the episode.
        tasks: index of its task, or one for each frame.
    """
    frames = np.arange(len(table), dtype=np.int64)
    index_columns = {
        "timestamp": (frames / fps).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.full_like(frames, episode),
        "index": start + frames,
        "task_index": np.zeros_like(frames) + tasks,
    }
    for name, column in index_columns.items():
        table = table.append_column(name, to_arrow(column[:, None]))
    return table


def episode_row(
    table: pa.Table,
    tasks: Sequence[str],
    found: Mapping[str, Any],
    data_file: FileNumber,
    episodes_file: FileNumber,
) -> dict[str, Any]:
    """Return an episode's row in `meta/episodes`.

    Args:
        table: its frames, with the index columns.
        tasks: its tasks, each once.
        found: its statistics, under their names there.
        data_file: number of the data file that it is in.
        episodes_file: number of the file of episodes that the row is in.
    """
    start = table["index"][0].as_py()
    row = {
        "episode_index": table["episode_index"][0].as_py(),
        "tasks": [*tasks],
        "length": len(table),
        "dataset_from_index": start,
        "dataset_to_index": start + len(table),
        **found,
    }
    for kind, file in (("data", data_file), ("meta/episodes", episodes_file)):
        row |= {f"{kind}/{name}": number for name, number in file._asdict().items()}
    return row


def parquet_content(table: pa.Table) -> pa.Buffer:
    """Return the content of a Parquet file."""
    content = pa.BufferOutputStream()
    pq.write_table(table, content, compression="snappy")
    return content.getvalue()


def write_synced(path: Path, content: bytes | pa.Buffer) -> None:
    """Write a new file that is on the disk afterwards."""
    with open_synced(path) as file:
        file.write(content)
