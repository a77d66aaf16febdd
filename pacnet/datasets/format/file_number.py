"""The numbers that files of a dataset are called by."""

from typing import NamedTuple


class FileNumber(NamedTuple):
    """The number of a data file or of a file of episodes."""

    chunk_index: int
    file_index: int

    def next(self, chunks_size: int) -> "FileNumber":
        """Return the following number, for chunks of `chunks_size` files."""
        if self.file_index == chunks_size - 1:
            return FileNumber(self.chunk_index + 1, 0)
        return FileNumber(self.chunk_index, self.file_index + 1)
