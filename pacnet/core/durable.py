"""Durable files: complete and on the disk, or absent.

Every write makes a new file, so it never follows a link at the path.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

NEW = ".new"  # suffix of a file that is not yet complete


@contextmanager
def open_synced(path: Path) -> Iterator[IO[bytes]]:
    """Open a new file for writing that is on the disk after the block; a file there is deleted."""
    path.unlink(missing_ok=True)
    with path.open("xb") as file:  # exclusively, which never follows a symbolic link
        yield file
        file.flush()
        os.fsync(file.fileno())


def write_atomically(path: Path, content: bytes) -> None:
    """Replace the file at the path; after a crash the old or the new one is intact."""
    new = path.with_name(path.name + NEW)
    with open_synced(new) as file:
        file.write(content)
    new.replace(path)
    sync_folder(path.parent)


def make_folder(folder: Path) -> None:
    """Make a folder and its parents, where they are missing, and sync them to the disk."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Sync the renames and deletions in a folder to the disk, where the system can."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
