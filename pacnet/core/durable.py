"""Files that are whole and on the disk before anything rests on them.

What is written is a file of its own: neither a link at its name nor another name of the same file
leads elsewhere.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

NEW = ".new"  # suffix of a file that is not whole yet


@contextmanager
def written_through(path: Path) -> Iterator[IO[bytes]]:
    """A file to write, which is down on the disk after the block: its rename cannot overtake it.

    What is at `path` already is deleted, not written into.
    """
    with _made_anew(path) as file:
        yield file
        file.flush()
        os.fsync(file.fileno())


def _made_anew(path: Path) -> IO[bytes]:
    """A new file, opened exclusively, which never follows a symbolic link."""
    try:
        return path.open("xb")
    except FileExistsError:
        path.unlink()
        return path.open("xb")


def put_in_place(path: Path, content: bytes) -> None:
    """Writes a file that is there as a whole or not at all, whenever the process is killed."""
    fresh = path.with_name(path.name + NEW)
    with written_through(fresh) as file:
        file.write(content)
    fresh.replace(path)
    flush_folder(path.parent)


def make_folder(folder: Path) -> None:
    """Makes a folder and its parents, where they are missing, as durable as what it will hold."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        flush_folder(path.parent)


def flush_folder(folder: Path) -> None:
    """Makes the renames and deletions in a folder durable, where the system can."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
