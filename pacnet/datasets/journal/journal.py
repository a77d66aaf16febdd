"""The journal of a recording: each finished episode in a file of its own, until all are folded.

It lies in the dataset's folder, as `journal/`, and goes when the recording is closed. Who holds the
lock in it records. Each episode's file says all that is needed to make a dataset of it, and ends
with its checksum.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Self

from numpy.typing import NDArray

from pacnet.core.durable import write_atomically
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.features import Recording
from pacnet.datasets.format.lerobot_files import INFO
from pacnet.datasets.format.places import EPISODE_FILE, JOURNAL, check_journal
from pacnet.datasets.journal.journal_files import episode_bytes
from pacnet.datasets.journal.lock import delete_locked, lock_file
from pacnet.datasets.journal.staging import is_complete

_LOCK = "lock"


class Journal:
    """The journal of one dataset, this process's alone until it is closed.

    Attributes:
        root: The dataset's folder.
        folder: The journal's.
    """

    def __init__(self, root: Path) -> None:
        """Make the folders where they are missing, and take the lock.

        Raises:
            BlockingIOError: Somebody else records into the dataset.
            FileExistsError: There is something at `root` that is no dataset.
            DatasetError: There is something in the journal that no recording has left there.
        """
        check_journal(root / JOURNAL)
        self.root, self.folder = root, root / JOURNAL
        self._process = os.getpid()
        self._made_root = not root.exists()
        self._lock = _locked(root)
        try:
            last = self.episodes()[-1:]
            if not last:
                _check_free(root)
        except BaseException:
            self.close()
            raise
        self._next = _number(last[0]) + 1 if last else 0

    @property
    def is_forked(self) -> bool:
        """Whether this process is a fork of the one whose journal it is."""
        return os.getpid() != self._process

    def episodes(self) -> list[Path]:
        """The files of the episodes, in the order in which they were saved."""
        return _episodes(self.folder)

    def add(self, recording: Recording, task: str, columns: Mapping[str, NDArray]) -> None:
        """Append an episode, which is on the disk when this returns.

        Args:
            recording: What it is an episode of.
            task: The task in words.
            columns: Feature name -> its values, [T, D] of the feature's dtype.
        """
        content = episode_bytes(recording, task, columns)
        write_atomically(self.folder / f"episode-{self._next:06d}.arrow", content)
        self._next += 1

    def close(self) -> None:
        """Release the lock; folders that hold nothing then go. A fork leaves all as it is."""
        if self.is_forked:
            self._lock.close()
            return
        delete_locked(self.folder / _LOCK, self._lock)
        with suppress(OSError):  # it holds episodes, or somebody else has opened it by now
            self.folder.rmdir()
            if self._made_root:
                self.root.rmdir()

    def __enter__(self) -> Self:
        """The journal, which is open from its making on."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the lock."""
        self.close()


def has_journal(root: Path) -> bool:
    """Whether there is a journal in a dataset's folder, be it empty."""
    return (root / JOURNAL).is_dir()


def check_folded(root: str | Path) -> None:
    """Refuse a dataset with episodes in its journal, which no reader finds there.

    Raises:
        DatasetError: There are some; the message says how they become part of the dataset.
    """
    journal = Path(root) / JOURNAL
    count = len(_episodes(journal))
    if count and not is_complete(journal):
        raise DatasetError(
            f"{root} has {count} episodes in its journal: the recording goes on, or was killed and "
            f"is completed by pacnet.datasets.recover({str(root)!r})"
        )


def _episodes(journal: Path) -> list[Path]:
    check_journal(journal)
    return sorted(journal.glob("episode-*.arrow"), key=_number)


def _number(path: Path) -> int:
    """The number of an episode's file, which its name tells."""
    match = EPISODE_FILE.fullmatch(path.name)
    if match is None:
        raise DatasetError(f"expected files like episode-000000.arrow, found {path}: move it away")
    return int(match[1])


def _locked(root: Path) -> IO[bytes]:
    try:
        return lock_file(root / JOURNAL / _LOCK)
    except BlockingIOError:
        raise BlockingIOError(
            f"expected to record into {root} alone, another recording into it goes on"
        ) from None
    except (FileExistsError, NotADirectoryError):
        raise _taken(root) from None


def _check_free(root: Path) -> None:
    """Refuse a folder of something else; one without files is left of a recording not begun."""
    if not (root / INFO).exists() and {path.name for path in root.iterdir()} != {JOURNAL}:
        raise _taken(root)


def _taken(root: Path) -> FileExistsError:
    return FileExistsError(f"expected a dataset or a folder to be made, {root} exists")
