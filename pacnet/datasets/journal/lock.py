"""A lock on a file that one process holds at a time, and that goes with the process and its forks.

The system releases it however they end, so a killed one bars nobody. On systems without `flock`
(Windows) nothing is locked.
"""

import os
from contextlib import suppress
from pathlib import Path
from typing import IO

from pacnet.core.durable import make_folder

_ATTEMPTS = 100  # at making a file whose folder others delete and make again


def lock_file(path: Path) -> IO[bytes]:
    """Make a file in a folder, both if they are missing, and lock it until it is closed.

    Who holds the lock may delete the file and its folder: it is then made again.

    Raises:
        BlockingIOError: Another process, or another opening of the file, holds the lock.
        OSError: There is a link in its place, which is not followed.
    """
    while True:
        file = _made(path)
        try:
            _lock(file)
            if _is_still(path, file):
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def delete_locked(path: Path, file: IO[bytes]) -> None:
    """Delete a locked file and release the lock, in this order where the system can."""
    if os.name == "nt":  # no open file can be deleted there
        file.close()
    try:
        path.unlink(missing_ok=True)
    finally:
        file.close()


def _made(path: Path) -> IO[bytes]:
    """The file and its folder, which whoever held the lock may be deleting just now."""
    for _ in range(_ATTEMPTS):
        with suppress(FileNotFoundError, FileExistsError):
            return _make(path)
    return _make(path)


def _make(path: Path) -> IO[bytes]:
    make_folder(path.parent)
    # With an opener, which `Path.open` does not take.
    return open(path, "ab", opener=_open_no_link)


def _open_no_link(path: str, flags: int) -> int:
    """Open what is no link, without waiting for the reader of a pipe."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)


def _lock(file: IO[bytes]) -> None:
    try:
        import fcntl
    except ImportError:
        return
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _is_still(path: Path, file: IO[bytes]) -> bool:
    """Whether the open file is the one that goes by its name now."""
    try:
        return os.path.samestat(path.lstat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
