"""One episode of a journal as a file: an Arrow stream followed by its checksum."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import (
    Arrays,
    Feature,
    Picture,
    Recording,
    checked_recording,
    is_text,
)
from pacnet.datasets.format.parquet import to_arrow, to_arrow_bytes, to_numpy

_HEADER = b"pacnet"  # key of an episode's description in its file
_CHECKSUM_BYTES = 32
_MALFORMED = (KeyError, OSError, RecursionError, TypeError, ValueError, pa.ArrowException)


def episode_bytes(
    recording: Recording, task: str, columns: Arrays, images: Mapping[str, Sequence[bytes]]
) -> bytes:
    """Return the content of an episode's file.

    Args:
        recording: what it is part of.
        task: its task.
        columns: its features `[T, D]`.
        images: camera -> T pictures as PNG.
    """
    header = {
        "fps": recording.fps,
        "features": [(name, one.names, one.dtype) for name, one in recording.features.items()],
        "robot_type": recording.robot_type,
        "task": task,
    }
    if recording.cameras:
        header["cameras"] = [
            (name, one.height, one.width) for name, one in recording.cameras.items()
        ]
    stored = {name: to_arrow(columns[name]) for name in recording.features}
    stored |= {name: to_arrow_bytes(images[name]) for name in recording.cameras}
    table = pa.table(stored, metadata={_HEADER: json.dumps(header).encode()})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    stored = sink.getvalue()
    return b"".join((stored, hashlib.sha256(stored).digest()))


def read_episode(path: Path) -> tuple[Recording, str, pa.Table]:
    """Return an episode's recording, its task, and its features, one row per frame.

    Pictures are as PNG, and are not decoded here.
    """
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
    features: dict[str, Feature | Picture] = {
        name: Feature(names, dtype) for name, names, dtype in header["features"]
    }
    cameras = header.get("cameras", [])
    features |= {name: Picture(height, width) for name, height, width in cameras}
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
    } | {name: to_arrow_bytes([]).type for name in recording.cameras}
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
    for name in recording.cameras:
        if table[name].null_count:
            raise ValueError(f"expected pictures in {name!r}, found gaps")
