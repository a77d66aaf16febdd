"""Places in a dataset's folder, which its files name and nobody has vouched for.

The dataset's folder itself may be a link. Within it, nothing is written, moved or deleted that a
link leads out of it.
"""

import os
import re
from pathlib import Path
from typing import TypeGuard

from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.features import is_text

JOURNAL = "journal"
STAGED = "fold"  # folder in the journal
EPISODE_FILE = re.compile(r"episode-([0-9]{6,})\.arrow")  # in the journal

_LONGEST = 255  # bytes of a place; every file system takes them
_DATA_PATH = re.compile(
    r"data/[\w.-]*\{chunk_index(:0?[1-9]d)?\}[\w.-]*/[\w.-]*\{file_index(:0?[1-9]d)?\}[\w.-]*"
    r"\.parquet",
    re.ASCII,
)
_VIDEO_FIELD = re.compile(r"\{(video_key|chunk_index:0?[1-9]d|file_index:0?[1-9]d)\}")
_PLAIN = re.compile(r"[\w-][\w.-]*(/[\w-][\w.-]*)*", re.ASCII)


def within(root: Path, place: object) -> Path:
    """Return the path of a place in a dataset, whether or not something is there yet.

    Raises:
        DatasetError: It is no relative path of plain parts, or a link leads it out of the dataset.
    """
    if not _is_plain(place):
        raise DatasetError(
            f"expected a place in the dataset, as parts joined by '/', found {place!r}"
        )
    path = root / place
    if not real_path(path).is_relative_to(real_path(root)):
        raise DatasetError(
            f"expected a place in the dataset, found {path}, a link to {real_path(path)}"
        )
    return path


def free_for_file(root: Path, place: object) -> Path:
    """Return the path of a place that a file can be moved to, be it over another file.

    Raises:
        DatasetError: As `within`, or there is a folder, or a file where its folder would be.
    """
    path = within(root, place)
    if path.is_dir():
        raise DatasetError(f"expected a file or nothing at {path}, found a folder")
    for parent in path.relative_to(root).parents:
        if os.path.lexists(root / parent) and not (root / parent).is_dir():
            raise DatasetError(f"expected a folder or nothing at {root / parent}, found a file")
    return path


def real_path(path: Path) -> Path:
    """Return where a path leads in the end; a circle of links leads to itself."""
    return Path(os.path.realpath(path))


def _is_plain(place: object) -> TypeGuard[str]:
    if not is_text(place) or len(place.encode()) > _LONGEST or set(place) & set("\0\\:"):
        return False
    return not {"", ".", ".."} & {*place.split("/")}


def check_journal(folder: Path) -> None:
    """Refuse a journal with anything but files and the folder of staged files, no links among them.

    Raises:
        DatasetError: There is something else in it, or it is a link itself.
    """
    if folder.is_symlink():
        raise DatasetError(f"expected a folder of the dataset's own at {folder}, found a link")
    for entry in _entries(folder):
        if entry.name == STAGED and entry.is_dir(follow_symlinks=False):
            strange = [staged for staged in _entries(Path(entry.path)) if not _is_file(staged)]
        else:
            strange = [] if _is_file(entry) else [entry]
        if strange:
            raise DatasetError(f"expected a file at {strange[0].path}, found a link or a folder")


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """What is in a folder; nothing is where there is none, or somebody has just deleted it."""
    try:
        with os.scandir(folder) as entries:
            return [*entries]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _is_file(entry: os.DirEntry[str]) -> bool:
    return entry.is_file(follow_symlinks=False)


def check_data_path(data_path: object) -> None:
    """Refuse a template that names anything but a file of its own for each number of a file.

    Raises:
        DatasetError: It is not `data/`, a folder with `{chunk_index}` and a file with
            `{file_index}` in its name.
    """
    if not isinstance(data_path, str) or not _DATA_PATH.fullmatch(data_path):
        raise DatasetError(
            "expected a data_path like data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet, "
            f"found {data_path!r}"
        )


def check_video_path(video_path: object, video_keys: list[str]) -> None:
    """Refuse a template and features that name videos outside of the dataset's folder.

    Raises:
        DatasetError: There is another field in it than the three that LeRobot fills in, or a part
            or the name of a feature is none of a plain path.
    """
    filled = _VIDEO_FIELD.sub("x", video_path) if isinstance(video_path, str) else ""
    if not _PLAIN.fullmatch(filled):
        raise DatasetError(
            "expected a video_path like videos/{video_key}/chunk-{chunk_index:03d}/"
            f"file-{{file_index:03d}}.mp4, found {video_path!r}"
        )
    for key in video_keys:
        if not _is_plain(key) or "/" in key:
            raise DatasetError(f"expected names of videos without '/', found {key!r}")
