"""The journal of a recording: one file for each finished episode, until all are folded.

It is the folder `journal/` of the dataset and is deleted when the recording is closed. The process
that holds the lock in it is the one that records.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

from filelock import BaseFileLock, FileLock, Timeout

from pacnet.core.durable import make_folder, write_atomically
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import Arrays, Recording
from pacnet.datasets.format.info import INFO
from pacnet.datasets.journal.episode_file import episode_bytes
from pacnet.datasets.journal.staging import EPISODE_FILE, check_journal, is_complete

JOURNAL = "journal"
_LOCK = "lock"
_ATTEMPTS = 100  # at locking a file whose folder other processes delete and make again


class Journal:
    """The journal of one dataset, open to this process alone.

    Attributes:
        root: the dataset's folder.
        folder: folder of the journal.
    """

    def __init__(self, root: Path) -> None:
        """Make the folders where they are missing, and take the lock.

        Raises:
            BlockingIOError: another process records into the dataset.
            FileExistsError: `root` exists and is not a dataset.
            DatasetError: the journal holds something other than a recording.
        """
        check_journal(root / JOURNAL)
        self.root, self.folder = root, root / JOURNAL
        self._process = os.getpid()
        self._made_root = not root.exists()
        self._lock = acquire_lock(root)
        try:
            last = self.episodes()[-1:]
            # A recording that is killed at its start leaves a folder with only a journal.
            is_ours = last or (root / INFO).exists()
            if not is_ours and {path.name for path in root.iterdir()} != {JOURNAL}:
                raise _exists(root)
        except BaseException:
            self.close()
            raise
        self._next = _index_of(last[0]) + 1 if last else 0

    @property
    def is_forked(self) -> bool:
        """Whether this process is a fork of the one that opened the journal."""
        return os.getpid() != self._process

    def episodes(self) -> list[Path]:
        """Return the files of the episodes, in the order in which they were saved."""
        return _episode_files(self.folder)

    def add(
        self,
        recording: Recording,
        task: str,
        columns: Arrays,
        images: Mapping[str, Sequence[bytes]] = MappingProxyType({}),
    ) -> None:
        """Append an episode; it is on the disk when this returns.

        Args:
            recording: what it is part of.
            task: its task.
            columns: its features `[T, D]`.
            images: camera -> T pictures as PNG.
        """
        content = episode_bytes(recording, task, columns, images)
        write_atomically(self.folder / f"episode-{self._next:06d}.arrow", content)
        self._next += 1

    def close(self) -> None:
        """Release the lock, then delete empty folders; do nothing in a fork of the process."""
        if self.is_forked:  # filelock has closed the fork's copy of the lock file
            return
        delete_and_release(self._lock)
        with suppress(OSError):  # it holds episodes, or another process has opened it by now
            self.folder.rmdir()
            if self._made_root:
                self.root.rmdir()


def check_folded(root: str | Path) -> None:
    """Refuse a dataset with episodes that are still in its journal, which readers do not find."""
    journal = Path(root) / JOURNAL
    count = len(_episode_files(journal))
    if count and not is_complete(journal):
        raise DatasetError(
            f"{root} has {count} episodes in its journal: it is still being recorded, or "
            f"was killed and is completed by pacnet.datasets.recover({str(root)!r})"
        )


def _episode_files(journal: Path) -> list[Path]:
    check_journal(journal)
    return sorted(journal.glob("episode-*.arrow"), key=_index_of)


def _index_of(path: Path) -> int:
    match = EPISODE_FILE.fullmatch(path.name)
    if match is None:
        raise DatasetError(f"expected files like episode-000000.arrow, found {path}: move it away")
    return int(match[1])


def acquire_lock(root: Path) -> BaseFileLock:
    """Lock the dataset's journal without waiting, after making its folder where it is missing."""
    # Any thread may close the recorder that another one opened.
    lock = FileLock(root / JOURNAL / _LOCK, timeout=0, thread_local=False)
    for _ in range(_ATTEMPTS):
        try:
            make_folder(root / JOURNAL)
            lock.acquire()
        except Timeout:
            raise BlockingIOError(
                f"expected to be the only recording into {root}, another one is in progress"
            ) from None
        except (FileNotFoundError, FileExistsError):  # another process may be closing its journal
            continue
        except NotADirectoryError:
            break
        return lock
    raise _exists(root)


def delete_and_release(lock: BaseFileLock) -> None:
    """Delete the lock's file while this process holds it, and release it."""
    with suppress(PermissionError):  # Windows deletes no open file; there, `release` deletes it
        Path(lock.lock_file).unlink(missing_ok=True)
    lock.release()


def _exists(root: Path) -> FileExistsError:
    return FileExistsError(f"expected a dataset or a folder to be made, {root} exists")
