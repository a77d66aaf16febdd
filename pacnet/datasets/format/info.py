"""`meta/info.json`, which describes a dataset's features and counts its frames."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard

from pacnet.datasets.format import DatasetError, unreadable
from pacnet.datasets.format.features import (
    INDEX_COLUMNS,
    RESERVED,
    Picture,
    Recording,
)
from pacnet.datasets.format.paths import DATA_PATH, VIDEO_PATH, check_data_path

FORMAT_VERSION = "v3.0"
READ_VERSIONS = ("v2.0", "v2.1", FORMAT_VERSION)
INFO = "meta/info.json"
VIDEO = "video"  # dtype of a camera whose pictures are in video files
# Of small pictures all colours are kept: halved, an object of a few pixels is lost.
ALL_COLOURS, SOME_COLOURS = "yuv444p", "yuv420p"
SMALL = 256  # pixels of the longer side

# What LeRobot assumes where a dataset does not say it.
_DEFAULTS = {"chunks_size": 1000, "data_files_size_in_mb": 100, "data_path": DATA_PATH}

_MAX_DEPTH = 4  # of nested names


def read_info(root: Path) -> dict[str, Any]:
    """Read the description of a dataset; its counts and `fps` may be missing or wrong."""
    path = root / INFO
    if not root.is_dir():
        raise DatasetError(f"expected the folder of a LeRobot dataset, found no folder {root}")
    if not path.is_file():
        raise DatasetError(f"{root} is no LeRobot dataset: it has no meta/info.json")
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise unreadable(path, error) from error
    if not isinstance(info, dict):
        raise DatasetError(f"{path}: expected an object, found {type(info).__name__}")
    storage = info.get("storage_format")
    if storage not in (None, "parquet"):
        raise DatasetError(
            f"{root} is stored as {storage!r} (storage_format in meta/info.json), which pacnet "
            "does not read: expected Parquet files, as LeRobot writes by default"
        )
    version = info.get("codebase_version")
    if version not in READ_VERSIONS:
        raise DatasetError(
            f"{path}: expected codebase_version {', '.join(READ_VERSIONS)}, found {version}"
        )
    if not isinstance(info.get("features"), dict):
        raise DatasetError(f"{path}: expected the dataset's features, found {info.get('features')}")
    return info


def is_rate(fps: object) -> TypeGuard[float]:
    """Return whether this is a number of frames per second."""
    if isinstance(fps, bool) or not isinstance(fps, int | float):
        return False
    return 0 < fps <= sys.float_info.max


def _check_positive(path: Path, info: dict[str, Any], name: str) -> None:
    if not is_rate(info.get(name)):
        raise DatasetError(f"{path}: expected {name} above 0 and finite, found {info.get(name)!r}")


def listed_names(feature: Mapping[str, Any]) -> list[str] | None:
    """Return the names of a feature's dimensions, where `meta/info.json` has one for each.

    Some robots' datasets keep them by kind of part, {"motors": ["shoulder", ...]}, or in a list of
    lists, and some teleoperators' with their indices, {"delta_x": 0, ...}.
    """
    names = [*_flat(feature.get("names"))]
    if not names or [len(names)] != feature.get("shape"):
        return None
    return names


def _flat(names: object, depth: int = 0) -> Iterator[str]:
    """Yield the names in nested lists and mappings."""
    if isinstance(names, dict):
        if names and all(type(index) is int for index in names.values()):
            names = sorted(names, key=names.__getitem__)
        else:
            names = [*names.values()]
    if isinstance(names, list) and depth < _MAX_DEPTH:
        for name in names:
            yield from _flat(name, depth + 1)
    elif isinstance(names, str | int | float):
        yield str(names)


def image_features(info: Mapping[str, Any], *dtypes: str) -> list[str]:
    """Return the names of the features of these dtypes; by default, of images and videos."""
    return [
        name for name, feature in info["features"].items()
        if isinstance(feature, dict) and feature.get("dtype") in (dtypes or ("image", "video"))
    ]  # fmt: skip


def new_info(recording: Recording) -> dict[str, Any]:
    """Return the description of a dataset without episodes, in LeRobot's order of the entries."""
    features = {
        name: {"dtype": feature.dtype, "shape": [len(feature.names)], "names": [*feature.names]}
        for name, feature in recording.features.items()
    }
    features |= {
        name: _camera_entry(picture, recording.fps) for name, picture in recording.cameras.items()
    }
    index_columns = {
        name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in INDEX_COLUMNS.items()
    }
    return {
        "codebase_version": FORMAT_VERSION,
        "robot_type": recording.robot_type,
        "total_episodes": 0,
        "total_frames": 0,
        "total_tasks": 0,
        "chunks_size": _DEFAULTS["chunks_size"],
        "data_files_size_in_mb": _DEFAULTS["data_files_size_in_mb"],
        "video_files_size_in_mb": 200,
        "fps": recording.fps,
        "splits": {},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH if recording.cameras else None,
        "features": features | index_columns,
    }


def _camera_entry(picture: Picture, fps: float) -> dict[str, Any]:
    """Return the description of a camera."""
    names = ["height", "width", "channels"]
    shape = [*picture.shape]
    return {"dtype": VIDEO, "shape": shape, "names": names, "info": video_details(shape, fps)}


def video_details(shape: Sequence[int], fps: float) -> dict[str, Any]:
    """Return what LeRobot says about videos, for those that we encode."""
    height, width, channels = shape
    return {
        "video.height": height,
        "video.width": width,
        "video.codec": "h264",
        "video.pix_fmt": SOME_COLOURS if max(height, width) > SMALL else ALL_COLOURS,
        "video.is_depth_map": False,
        "video.fps": int(fps),
        "video.channels": channels,
        "has_audio": False,
    }


def read_appendable_info(root: Path) -> dict[str, Any]:
    """Read the description of a dataset to append to, with LeRobot's defaults filled in."""
    path, info = root / INFO, read_info(root)
    if info["codebase_version"] != FORMAT_VERSION:
        raise DatasetError(
            f"{path}: expected codebase_version {FORMAT_VERSION} to append to, found "
            f"{info['codebase_version']}: `pacnet export` copies older datasets to it"
        )
    _check_positive(path, info, "fps")
    info |= _DEFAULTS | info
    for name in ("total_frames", "total_episodes"):
        if info.get(name) is not None and not _is_integer(info[name], 0):
            raise DatasetError(f"{path}: expected {name} as an integer, found {info[name]!r}")
    if not _is_integer(info["chunks_size"], 1):
        raise DatasetError(f"{path}: expected chunks_size above 0, found {info['chunks_size']!r}")
    _check_positive(path, info, "data_files_size_in_mb")
    check_data_path(info["data_path"])
    _check_features(path, info["features"])
    try:
        json_bytes(info)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path}: expected what JSON in UTF-8 can hold: {error}") from None
    return info


def _is_integer(number: object, least: int) -> bool:
    return type(number) is int and least <= number < 2**53


def _check_features(path: Path, features: dict[str, Any]) -> None:
    """Refuse features without a dtype and a shape, and other index columns than new frames get."""
    for name, feature in features.items():
        shape = feature.get("shape") if isinstance(feature, dict) else None
        sized = isinstance(shape, list) and shape and all(_is_integer(size, 1) for size in shape)
        if not sized or not isinstance(feature.get("dtype"), str):
            raise DatasetError(
                f"{path}: expected {name!r} with a dtype and a shape of lengths above 0, "
                f"found {feature!r}"
            )
    for name, dtype in INDEX_COLUMNS.items():
        feature = features.get(name, {})
        if (feature.get("dtype"), feature.get("shape")) != (dtype, [1]):
            raise DatasetError(f"{path}: expected {name!r} as one {dtype}, found {feature!r}")
    others = {*RESERVED} & {*features} - {*INDEX_COLUMNS}
    if others:
        raise DatasetError(f"{path}: expected no features {sorted(others)}, which are the format's")


def json_bytes(content: Mapping[str, Any]) -> bytes:
    """Return JSON, indented as LeRobot does; raise a ValueError for NaN and infinity."""
    return json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False).encode()
