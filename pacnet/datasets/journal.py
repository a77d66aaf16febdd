"""The journal of a recording: each finished episode in a file of its own, until all are folded.

It lies in the dataset's folder, as `journal/`, and goes when the recording is closed. Who holds the
lock in it records. Each episode's file says all that is needed to make a dataset of it, and ends
with its checksum.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Self

from numpy.typing import NDArray

from pacnet.datasets.arrow_columns import to_arrow
from pacnet.datasets.lerobot_files import INFO, DatasetError
from pacnet.datasets.lock import delete_locked, lock_file
from pacnet.datasets.recording import Feature, Recording
from pacnet.datasets.staging import is_complete
from pacnet.durable import put_in_place

if TYPE_CHECKING:
    import pyarrow as pa

_FOLDER, _LOCK = "journal", "lock"
_HEADER = b"pacnet"  # key of an episode's description in its file
_CHECKSUM = 32  # bytes of it at the end of an episode's file


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
        """
        self.root, self.folder = root, root / _FOLDER
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
        self._next = int(last[0].stem.removeprefix("episode-")) + 1 if last else 0

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
        content = _episode_bytes(recording, task, columns)
        put_in_place(self.folder / f"episode-{self._next:06d}.arrow", content)
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


def read_episode(path: Path) -> tuple[Recording, str, "pa.Table"]:
    """What an episode belongs to, its task, and its features, one row per frame.

    Raises:
        DatasetError: The file is damaged.
    """
    import pyarrow as pa

    content = memoryview(path.read_bytes())
    stored, checksum = content[:-_CHECKSUM], content[-_CHECKSUM:]
    if hashlib.sha256(stored).digest() != checksum:
        raise DatasetError(f"{path} is damaged: once it is moved away, the rest can be recovered")
    with pa.ipc.open_stream(pa.py_buffer(stored)) as reader:
        table = reader.read_all()
    told = json.loads(table.schema.metadata[_HEADER])
    features = {name: Feature(tuple(names), dtype) for name, names, dtype in told["features"]}
    recording = Recording(told["fps"], features, told["robot_type"])
    return recording, told["task"], table.replace_schema_metadata()


def has_journal(root: Path) -> bool:
    """Whether there is a journal in a dataset's folder, be it empty."""
    return (root / _FOLDER).is_dir()


def check_folded(root: str | Path) -> None:
    """Refuse a dataset with episodes in its journal, which no reader finds there.

    Raises:
        DatasetError: There are some; the message says how they become part of the dataset.
    """
    journal = Path(root) / _FOLDER
    count = len(_episodes(journal))
    if count and not is_complete(journal):
        raise DatasetError(
            f"{root} has {count} episodes in its journal: the recording goes on, or was killed and "
            f"is completed by pacnet.recorder.recover({str(root)!r})"
        )


def _episodes(journal: Path) -> list[Path]:
    return sorted(journal.glob("episode-*.arrow"), key=lambda path: path.name)


def _locked(root: Path) -> IO[bytes]:
    try:
        return lock_file(root / _FOLDER / _LOCK)
    except BlockingIOError:
        raise BlockingIOError(
            f"expected to record into {root} alone, another recording into it goes on"
        ) from None
    except (FileExistsError, NotADirectoryError):
        raise _taken(root) from None


def _check_free(root: Path) -> None:
    """Refuse a folder of something else; one without files is left of a recording not begun."""
    if not (root / INFO).exists() and {path.name for path in root.iterdir()} != {_FOLDER}:
        raise _taken(root)


def _taken(root: Path) -> FileExistsError:
    return FileExistsError(f"expected a dataset or a folder to be made, {root} exists")


def _episode_bytes(recording: Recording, task: str, columns: Mapping[str, NDArray]) -> bytes:
    import pyarrow as pa

    features = [(name, told.names, told.dtype) for name, told in recording.features.items()]
    told = recording._asdict() | {"features": features, "task": task}
    table = pa.table(
        {name: to_arrow(columns[name]) for name in recording.features},
        metadata={_HEADER: json.dumps(told).encode()},
    )
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    stored = sink.getvalue()
    return b"".join((stored, hashlib.sha256(stored).digest()))
