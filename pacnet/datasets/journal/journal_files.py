"""One episode of a journal as the content of a file, which ends with its checksum."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format.arrow_columns import to_arrow, to_numpy
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.features import Feature, Recording, checked_recording, is_text

if TYPE_CHECKING:
    import pyarrow as pa

_HEADER = b"pacnet"  # key of an episode's description in its file
_CHECKSUM = 32  # bytes of it at the end of an episode's file


def episode_bytes(recording: Recording, task: str, columns: Mapping[str, NDArray]) -> bytes:
    """The content of an episode's file.

    Args:
        recording: What it is an episode of.
        task: The task in words.
        columns: Feature name -> its values, [T, D] of the feature's dtype.
    """
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


def read_episode(path: Path) -> tuple[Recording, str, "pa.Table"]:
    """What an episode belongs to, its task, and its features, one row per frame.

    Raises:
        DatasetError: The file is damaged, or holds something else than `Recorder` stores.
    """
    import pyarrow as pa

    content = memoryview(path.read_bytes())
    stored, checksum = content[:-_CHECKSUM], content[-_CHECKSUM:]
    if hashlib.sha256(stored).digest() != checksum:
        raise DatasetError(f"{path} is damaged: once it is moved away, the rest can be recovered")
    try:
        with pa.ipc.open_stream(pa.py_buffer(stored)) as reader:
            recording, task = _read_header(reader.schema)
            _check_schema(reader.schema, recording)
            table = reader.read_all()
        _check_frames(table, recording)
    except (OSError, ValueError, RecursionError, pa.ArrowException) as error:
        raise DatasetError(
            f"{path} holds no episode ({error}): once it is moved away, the rest can be recovered"
        ) from None
    return recording, task, table.replace_schema_metadata()


def _read_header(schema: "pa.Schema") -> tuple[Recording, str]:
    """What an episode belongs to and its task, or a ValueError."""
    told = json.loads((schema.metadata or {}).get(_HEADER, b"null"))
    if not isinstance(told, dict):
        raise ValueError(f"expected a description, found {told!r}")
    features, task, fps = (told.get(name) for name in ("features", "task", "fps"))
    if not isinstance(features, list) or not all(map(_is_feature, features)):
        raise ValueError(f"expected features as [name, names, dtype], found {features!r}")
    if not is_text(task) or not task.strip():
        raise ValueError(f"expected the task in words, found {task!r}")
    if not isinstance(fps, int):
        raise ValueError(f"expected fps as an integer, found {fps!r}")
    named = {name: Feature(names, dtype) for name, names, dtype in features}
    return checked_recording(fps, named, told.get("robot_type")), task


def _is_feature(told: Any) -> bool:
    return isinstance(told, list) and [type(part) for part in told] == [str, list, str]


def _check_schema(schema: "pa.Schema", recording: Recording) -> None:
    """Refuse columns of other types before any is read: the types are of a fixed size."""
    wanted = {
        name: to_arrow(np.empty((0, len(told.names)), told.dtype)).type
        for name, told in recording.features.items()
    }
    found = [(field.name, field.type) for field in schema]
    if found != [*wanted.items()]:
        raise ValueError(f"expected the columns {wanted}, found {found}")


def _check_frames(table: "pa.Table", recording: Recording) -> None:
    """Refuse no frames, gaps, and numbers that are not finite."""
    table.validate(full=True)
    if not len(table):
        raise ValueError("expected frames, found none")
    for name, told in recording.features.items():
        if not np.isfinite(to_numpy(table[name], len(told.names))).all():
            raise ValueError(f"expected finite numbers in {name!r}, found others")
