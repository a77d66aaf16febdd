"""What `meta/info.json` says of a dataset, to be checked before anything is appended to it."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.features import RESERVED, STORED, Recording
from pacnet.datasets.format.lerobot_files import told_names
from pacnet.datasets.format.places import check_data_path
from pacnet.datasets.format.tables import json_bytes

# Columns that the format has beside the features.
OWN_COLUMNS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def check_appendable(path: Path, info: dict[str, Any]) -> None:
    """Refuse a description that says what appending needs in another form.

    Args:
        path: Of the description, for the message.
        info: What it says; counts may be missing.

    Raises:
        DatasetError: An entry is of another type, out of range, or cannot be written again.
    """
    for name in ("total_frames", "total_episodes"):
        if info.get(name) is not None and not _is_count(info[name], 0):
            raise DatasetError(f"{path}: expected {name} as an integer, found {info[name]!r}")
    if not _is_count(info["chunks_size"], 1):
        raise DatasetError(f"{path}: expected chunks_size above 0, found {info['chunks_size']!r}")
    size = info["data_files_size_in_mb"]
    if isinstance(size, bool) or not isinstance(size, int | float) or not 0 < size < math.inf:
        raise DatasetError(f"{path}: expected data_files_size_in_mb above 0, found {size!r}")
    check_data_path(info["data_path"])
    for name, told in info["features"].items():
        _check_feature(path, name, told)
    _check_own(path, info["features"])
    try:
        json_bytes(info)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: expected what JSON in UTF-8 can hold: {error}") from None


def _is_count(number: object, least: int) -> bool:
    return type(number) is int and least <= number < 2**53


def _check_feature(path: Path, name: str, told: object) -> None:
    shape = told.get("shape") if isinstance(told, dict) else None
    whole = isinstance(shape, list) and shape and all(_is_count(size, 1) for size in shape)
    if not isinstance(told, dict) or not whole or not isinstance(told.get("dtype"), str):
        raise DatasetError(
            f"{path}: expected {name!r} with a dtype and a shape of lengths above 0, found {told!r}"
        )


def _check_own(path: Path, features: dict[str, Any]) -> None:
    """Refuse other columns of the format's own than new frames are given."""
    for name, dtype in OWN_COLUMNS.items():
        told = features.get(name, {})
        if (told.get("dtype"), told.get("shape")) != (dtype, [1]):
            raise DatasetError(f"{path}: expected {name!r} as one {dtype}, found {told!r}")
    others = {*RESERVED} & {*features} - {*OWN_COLUMNS}
    if others:
        raise DatasetError(f"{path}: expected no features {sorted(others)}, which are the format's")


def check_same(root: Path, info: dict[str, Any], recording: Recording) -> None:
    """Refuse to append a recording to a dataset of something else.

    Raises:
        ValueError: The frames per second, the features or the robot's type differ, or there are
            features that no recording has.
    """
    there = {name: told for name, told in info["features"].items() if name not in RESERVED}
    for name, told in there.items():
        if told["dtype"] not in STORED:
            raise ValueError(
                f"expected a dataset of {', '.join(STORED)}, which is what Recorder stores: with "
                f"{name!r} being {told['dtype']}, {root} cannot be appended to with it"
            )
    if recording.fps != info["fps"]:
        raise ValueError(f"expected fps {info['fps']} as in {root}, got {recording.fps}")
    if set(there) != set(recording.features):
        raise ValueError(
            f"expected the features {sorted(there)} as in {root}, got {sorted(recording.features)}"
        )
    for name, told in recording.features.items():
        expected, got = _described(there[name], told.names), (told.dtype, list(told.names))
        if expected != got:
            raise ValueError(
                f"expected {name!r} as {expected[0]} of {expected[1]} as in {root}, "
                f"got {got[0]} of {got[1]}"
            )
    robot = info.get("robot_type")
    if recording.robot_type not in (None, robot):
        raise ValueError(
            f"expected robot_type {robot!r} as in {root}, got {recording.robot_type!r}"
        )


def _described(told: dict[str, Any], otherwise: Sequence[str]) -> tuple[str, list[str]]:
    """A feature's dtype and names; a dataset may be without names."""
    names, shape = told_names(told), list(told["shape"])
    if names is not None:
        return told["dtype"], names
    return told["dtype"], list(otherwise) if shape == [len(otherwise)] else [f"shape {shape}"]
