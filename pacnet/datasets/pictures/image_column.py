"""A camera whose pictures are PNG or JPEG in a column of the data files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import types

from pacnet.core.lfs import is_lfs_pointer
from pacnet.datasets.format import DatasetError, unreadable
from pacnet.datasets.format.frame_rows import FrameReader, Rows
from pacnet.datasets.format.paths import path_of_source
from pacnet.datasets.pictures.footage import Footage, Pictures
from pacnet.datasets.pictures.image_file import decode_image
from pacnet.datasets.pictures.reducing import reduce
from pacnet.datasets.pictures.stamps import stamp

_MAX_BYTES = 2**28  # of a picture's file


class ImageColumn:
    """The column of a camera's images, as LeRobot stores them: bytes, or the path of a file."""

    def __init__(self, root: Path, camera: str, files: Mapping[Path, int]) -> None:
        """Name the column.

        Args:
            root: the dataset's folder.
            camera: the column.
            files: data file -> number of its rows.
        """
        self._root, self._camera, self._paths = root, camera, [*files]
        self._starts = np.cumsum([0, *files.values()])
        self._reader = FrameReader([camera])
        self._in_files = False  # whether pictures are in files of their own

    def footage(self, rows: NDArray[np.int64]) -> Footage:
        """Return what is shown in these rows of all data files, one after the other."""
        files = np.searchsorted(self._starts, rows, side="right") - 1
        bounds = [0, *(np.flatnonzero(np.diff(files)) + 1), len(rows)]
        parts = [
            Rows(self._paths[files[first]], rows[first:end] - self._starts[files[first]])
            for first, end in pairwise(bounds)
        ]
        digest = hashlib.sha256(rows.tobytes()).hexdigest()
        stamps = [stamp(path) for path in dict.fromkeys(part.path for part in parts)]
        key = ("image", self._camera, *stamps, digest)
        return Footage(len(rows), key, lambda: self._frames(parts), lambda: not self._in_files)

    def close(self) -> None:
        """Do nothing: no file stays open."""

    def _frames(self, parts: list[Rows]) -> Iterator[tuple[int, Pictures]]:
        column = self._reader.frames(parts)[self._camera]
        kind = column.type
        if not types.is_struct(kind) and not types.is_binary(kind):
            raise DatasetError(f"expected images in {self._camera!r}, found {kind}")
        for number, cell in enumerate(column):
            try:
                yield number, reduce(decode_image(self._content(cell)))
            except DatasetError as error:
                raise type(error)(f"frame {number}: {error}") from error

    def _content(self, cell: pa.Scalar) -> bytes:
        """Return the file of a picture."""
        value = cell.as_py()
        if isinstance(value, bytes):
            return value
        value = value if isinstance(value, dict) else {}
        content, place = value.get("bytes"), value.get("path")
        if isinstance(content, bytes) and content:
            return content
        if place is None:
            raise DatasetError("expected a picture, found none")
        path, self._in_files = path_of_source(self._root, place), True
        try:
            if is_lfs_pointer(path):
                raise OSError("it is none")
            if path.stat().st_size > _MAX_BYTES:
                raise OSError(f"it has more than {_MAX_BYTES} bytes")
            return path.read_bytes()
        except OSError as error:
            raise unreadable(path, error) from error
