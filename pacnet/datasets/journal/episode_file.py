"""One episode of a journal as a file: an Arrow stream followed by its checksum."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pyarrow as pa

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import Arrays, Feature, Recording, checked_recording, is_text
from pacnet.datasets.format.parquet import to_arrow, to_numpy

_HEADER = b"pacnet"  # key of an episode's description in its file
_CHECKSUM_BYTES = 32
_MALFORMED = (KeyError, OSError, RecursionError, TypeError, ValueError, pa.ArrowException)


def episode_bytes(recording: Recording, task: str, columns: Arrays) -> bytes:
    """Return the content of an episode's file, from its features `[T, D]`."""
    features = [(name, one.names, one.dtype) for name, one in recording.features.items()]
    header = recording._asdict() | {"features": features, "task": task}
    table = pa.table(
        {name: to_arrow(columns[name]) for name in recording.features},
        metadata={_HEADER: json.dumps(header).encode()},
    )
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    stored = sink.getvalue()
    return b"".join((stored, hashlib.sha256(stored).digest()))


def read_episode(path: Path) -> tuple[Recording, str, pa.Table]:
    """Return an episode's recording, its task, and its features, one row per frame."""
    content = memoryview(path.read_bytes())
    stored, checksum = content[:-_CHECKSUM_BYTES], content[-_CHECKSUM_BYTES:]
    if hashlib.sha256(stored).digest() != checksum:
        raise DatasetError(f"{path} is damaged: once it is moved away, the rest can be recovered")
    try:
        with pa.ipc.open_stream(pa.py_buffer(stored)) as reader:
            recording, task = _read_header(reader.schema)
            _check_schema(reader.schema, recording)
            table = reader.read_all()
        _check_frames(table, recording)
    except _MALFORMED as error:
        raise DatasetError(
            f"{path} holds no episode ({error}): once it is moved away, the rest can be recovered"
        ) from None
    return recording, task, table.replace_schema_metadata()


def _read_header(schema: pa.Schema) -> tuple[Recording, str]:
    header = json.loads((schema.metadata or {})[_HEADER])
    features = {name: Feature(names, dtype) for name, names, dtype in header["features"]}
    recording = checked_recording(header["fps"], features, header["robot_type"])
    task = header["task"]
    if not is_text(task) or not task.strip():
        raise ValueError(f"expected the task in words, found {task!r}")
    return recording, task


def _check_schema(schema: pa.Schema, recording: Recording) -> None:
    """Refuse columns of other types before any is read; the expected types have a fixed size."""
    expected = {
        name: to_arrow(np.empty((0, len(feature.names)), feature.dtype)).type
        for name, feature in recording.features.items()
    }
    found = [(field.name, field.type) for field in schema]
    if found != [*expected.items()]:
        raise ValueError(f"expected the columns {expected}, found {found}")


def _check_frames(table: pa.Table, recording: Recording) -> None:
    """Refuse an empty table, gaps, and numbers that are not finite."""
    table.validate(full=True)
    if not len(table):
        raise ValueError("expected frames, found none")
    for name, feature in recording.features.items():
        if not np.isfinite(to_numpy(table[name], len(feature.names))).all():
            raise ValueError(f"expected finite numbers in {name!r}, found others")
