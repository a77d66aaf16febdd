"""Checks of the paths that a dataset's files name; the files may come from anywhere.

The dataset's folder itself may be a link. Within it, nothing is written, moved or deleted through a
link that leads out of it.
"""

import os
import re
from pathlib import Path
from typing import TypeGuard

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import is_text

_MAX_BYTES = 255  # of a relative path; every file system takes them
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_DATA_PATH_FORM = re.compile(
    r"data/[\w.-]*\{chunk_index(:0?[1-9]d)?\}[\w.-]*/[\w.-]*\{file_index(:0?[1-9]d)?\}[\w.-]*"
    r"\.parquet",
    re.ASCII,
)
_VIDEO_FIELD = re.compile(r"\{(video_key|chunk_index:0?[1-9]d|file_index:0?[1-9]d)\}")
_VIDEO_PATH = re.compile(r"[\w-][\w.-]*(/[\w-][\w.-]*)*", re.ASCII)


def path_inside(root: Path, relative: object) -> Path:
    """Return a path in a dataset after checking that no part or link leads out of it."""
    if not _is_plain(relative):
        raise DatasetError(
            f"expected a path in the dataset, as parts joined by '/', found {relative!r}"
        )
    path = root / relative
    if not real_path(path).is_relative_to(real_path(root)):
        raise DatasetError(
            f"expected a path in the dataset, found {path}, a link to {real_path(path)}"
        )
    return path


def path_of_source(root: Path, relative: object) -> Path:
    """Return a path in a dataset that is only read; Hugging Face's cache links to `blobs/`.

    There the dataset is `REPOSITORY/snapshots/REVISION`, and its files are links to
    `REPOSITORY/blobs/HASH`.
    """
    folder = real_path(root)
    if _is_plain(relative) and folder.parent.name == "snapshots":
        path = root / relative
        if real_path(path).parent == folder.parent.parent / "blobs":
            return path
    return path_inside(root, relative)


def path_for_file(root: Path, relative: object) -> Path:
    """Return a path in a dataset after checking that a file can be moved to it."""
    path = path_inside(root, relative)
    if path.is_dir():
        raise DatasetError(f"expected a file or nothing at {path}, found a folder")
    for parent in path.relative_to(root).parents:
        if os.path.lexists(root / parent) and not (root / parent).is_dir():
            raise DatasetError(f"expected a folder or nothing at {root / parent}, found a file")
    return path


def real_path(path: Path) -> Path:
    """Return a path with its links followed; a circle of links stays as it is."""
    return Path(os.path.realpath(path))


def _is_plain(relative: object) -> TypeGuard[str]:
    if not is_text(relative) or len(relative.encode()) > _MAX_BYTES or set(relative) & set("\0\\:"):
        return False
    return not {"", ".", ".."} & {*relative.split("/")}


def check_data_path(data_path: object) -> None:
    """Refuse a template unless it names a different file in `data/` for each pair of indices."""
    if not isinstance(data_path, str) or not _DATA_PATH_FORM.fullmatch(data_path):
        raise DatasetError(
            "expected a data_path like data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet, "
            f"found {data_path!r}"
        )


def check_video_path(video_path: object, video_keys: list[str]) -> None:
    """Refuse a template and features that name videos outside of the dataset's folder."""
    filled = _VIDEO_FIELD.sub("x", video_path) if isinstance(video_path, str) else ""
    if not _VIDEO_PATH.fullmatch(filled):
        raise DatasetError(
            "expected a video_path like videos/{video_key}/chunk-{chunk_index:03d}/"
            f"file-{{file_index:03d}}.mp4, found {video_path!r}"
        )
    for key in video_keys:
        if not _is_plain(key) or "/" in key:
            raise DatasetError(f"expected names of videos without '/', found {key!r}")
