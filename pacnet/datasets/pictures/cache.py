"""Reduced pictures kept on disk, so that each video is decoded once.

A file holds those of one camera in one episode: an array in numpy's format, followed by its
checksum. Its name is a digest of what the pictures depend on, so several processes may read and
write at the same time: who is last replaces a file by the same. The files used longest ago go
first.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import time
import warnings
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from pacnet.core.durable import NEW
from pacnet.datasets.format import DatasetWarning
from pacnet.datasets.pictures.footage import Footage, Pictures, gather
from pacnet.datasets.pictures.reducing import MAX_SIDE

VARIABLE = "PACNET_CACHE"
MAX_BYTES = 4 * 2**30
_FORM = 1  # of the files; another one when pictures are reduced otherwise
_NAME = re.compile(rf"[0-9a-f]{{64}}\.npy(\.[0-9a-f]+{NEW})?")
_CHECKSUM_BYTES = 4
_ABANDONED = 3600  # s without a change, after which a file that is not complete never will be


def cache_folder() -> Path:
    """Return the folder of the cache: in `PACNET_CACHE`, else in the user's cache.

    Raises:
        RuntimeError: the user has no home.
    """
    own = os.environ.get(VARIABLE)
    if own:
        return Path(own).expanduser().absolute() / "pictures"
    shared = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(shared) if Path(shared).is_absolute() else Path.home() / ".cache"
    return base / "pacnet" / "pictures"


class PictureCache:
    """The user's cache of pictures; where it cannot be written, pictures are in memory alone."""

    def __init__(self, max_bytes: int = MAX_BYTES) -> None:
        """Find the folder; it is made when the first pictures are kept.

        Args:
            max_bytes: what all files may take together.
        """
        self._max_bytes, self._new_bytes, self._folder = max_bytes, 0, None
        try:
            self._folder = cache_folder()
        except RuntimeError as error:
            _warn(error)

    def pictures(self, footage: Footage, progress: Callable[[int], object]) -> Pictures:
        """Return what is shown, decoded where it is not kept.

        Args:
            footage: what is shown.
            progress: called with the number of pictures that are ready since it was called last.

        Raises:
            DatasetError: as `gather`.
        """
        path = None if self._folder is None else self._folder / f"{_digest(footage)}.npy"
        kept = None if path is None else _read(path, footage.length)
        if kept is not None:
            progress(footage.length)
            return kept
        pictures = gather(footage, progress)
        if path is None or not footage.is_lasting():
            return pictures
        return self._keep(path, pictures)

    def close(self) -> None:
        """Delete what is beyond the bound."""
        if self._folder is not None and self._new_bytes:
            self._new_bytes = 0
            _trim(self._folder, self._max_bytes)

    def _keep(self, path: Path, pictures: Pictures) -> Pictures:
        """Write pictures, and return them as they are read back."""
        new = path.with_name(f"{path.name}.{secrets.token_hex(8)}{NEW}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                with new.open("xb") as file:
                    np.save(file, pictures)
                    file.write(_checksum(pictures))
                new.replace(path)
            finally:
                new.unlink(missing_ok=True)
        except OSError as error:
            _warn(error)
            self._folder = None
            return pictures
        self._new_bytes += pictures.nbytes
        if self._new_bytes > self._max_bytes // 8:
            self.close()
        kept = _read(path, len(pictures))
        return pictures if kept is None else kept


def _digest(footage: Footage) -> str:
    return hashlib.sha256(json.dumps([_FORM, MAX_SIDE, *footage.key]).encode()).hexdigest()


def _checksum(pictures: Pictures) -> bytes:
    return zlib.crc32(pictures.data).to_bytes(_CHECKSUM_BYTES, "little")


def _read(path: Path, length: int) -> Pictures | None:
    """Return pictures as a read-only map of their file; None if it is missing or damaged."""
    try:
        pictures = np.lib.format.open_memmap(path, mode="r")
        is_sound = pictures.dtype == np.uint8 and pictures.shape == (
            length,
            *pictures.shape[1:3],
            3,
        )
        if not is_sound or not pictures.flags.c_contiguous:
            return None
        with path.open("rb") as file:
            file.seek(pictures.offset + pictures.nbytes)
            if file.read() != _checksum(pictures):
                return None
        os.utime(path)  # it is used
    except (OSError, ValueError, OverflowError, MemoryError):
        return None
    return pictures


def _trim(folder: Path, max_bytes: int) -> None:
    """Delete the files used longest ago until the others fit, and those never completed."""
    with suppress(OSError):
        entries = [entry for entry in os.scandir(folder) if _NAME.fullmatch(entry.name)]
        found = []
        for entry in entries:
            with suppress(OSError):  # another process deletes as well
                status = entry.stat()
                if entry.name.endswith(NEW):
                    if status.st_mtime < time.time() - _ABANDONED:
                        Path(entry.path).unlink()
                    continue
                found.append((status.st_mtime, status.st_size, entry.path))
        total = sum(size for _, size, _ in found)
        for _, size, path in sorted(found):
            if total <= max_bytes:
                return
            with suppress(OSError):
                Path(path).unlink()
            total -= size


def _warn(error: Exception) -> None:
    warnings.warn(
        f"pictures cannot be kept, so they are decoded each time: set {VARIABLE} to a folder that "
        f"can be written ({error})",
        DatasetWarning,
        stacklevel=2,
    )
