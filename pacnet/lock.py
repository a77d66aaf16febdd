"""A lock on a file that one process holds at a time, and that goes with the process.

The system releases it however the process ends, so a killed one bars nobody. On systems without
`flock` (Windows) nothing is locked.
"""

import os
from pathlib import Path
from typing import IO


def lock_file(path: Path) -> IO[bytes]:
    """Make a file in a folder, both if they are missing, and lock it until it is closed.

    Who holds the lock may delete the file and its folder: it is then made again.

    Raises:
        BlockingIOError: Another process, or another opening of the file, holds the lock.
    """
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            file = path.open("ab")
        except FileNotFoundError:  # deleted with its folder just now
            continue
        try:
            _lock(file)
            if _is_still(path, file):
                return file
        except BaseException:
            file.close()
            raise
        file.close()


def _lock(file: IO[bytes]) -> None:
    try:
        import fcntl
    except ImportError:
        return
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _is_still(path: Path, file: IO[bytes]) -> bool:
    """Whether the open file is the one that goes by its name now."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
