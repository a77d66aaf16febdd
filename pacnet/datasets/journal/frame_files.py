"""The files that a dataset's new frames go to: one row group per episode, many episodes a file."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Self

from pacnet.core.durable import open_synced
from pacnet.datasets.format.files import Dataset, FileNumber
from pacnet.datasets.journal.staging import Stage

if TYPE_CHECKING:
    import pyarrow as pa


class FrameFiles:
    """Writes episodes, beginning with a new file and another wherever one would grow too large.

    Attributes:
        paths: The files written so far.
    """

    def __init__(self, dataset: Dataset, stage: Stage) -> None:
        """Nothing is written before the first episode is added.

        Args:
            dataset: What is appended to.
            stage: Where the files are written.
        """
        self.paths: list[Path] = []
        self._dataset, self._stage = dataset, stage
        self._number = dataset.next_frames
        self._limit = dataset.info["data_files_size_in_mb"] * 2**20  # bytes
        self._open = ExitStack()
        self._file: IO[bytes] | None = None

    def add(self, table: "pa.Table") -> FileNumber:
        """Append an episode.

        Returns:
            The file that it is in.
        """
        if self._file is None:
            self._begin(table.schema)
        elif self._file.tell() + table.nbytes > self._limit:
            self._open.close()
            self._number = self._number.next(self._dataset.info["chunks_size"])
            self._begin(table.schema)
        self._writer.write_table(table)
        return self._number

    def __enter__(self) -> Self:
        """The writer."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the last file, which is then whole and on the disk."""
        self._open.__exit__(kind, error, traceback)

    def _begin(self, schema: "pa.Schema") -> None:
        import pyarrow.parquet as pq

        path = self._stage.add(self._dataset.frames_place(self._number))
        self.paths.append(path)
        self._file = self._open.enter_context(open_synced(path))
        self._writer = self._open.enter_context(
            pq.ParquetWriter(self._file, schema, compression="snappy", use_dictionary=False)
        )
