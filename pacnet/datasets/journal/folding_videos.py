"""Fold the pictures of a journal into video files of its dataset, and what is said about them.

If the process is killed meanwhile, the journal still has them, and the next fold encodes them anew.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pacnet.datasets.format.appending import STATISTICS, Dataset
from pacnet.datasets.format.appending_videos import video_path
from pacnet.datasets.format.clips import POINTERS, Clip
from pacnet.datasets.format.features import Picture
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.info import video_details
from pacnet.datasets.format.paths import VIDEO_PATH
from pacnet.datasets.format.shades import Found, checked, joined
from pacnet.datasets.journal.episode_file import read_episode
from pacnet.datasets.journal.staging import Stage

_SLOW = 2  # s, after which a bar shows how far it is
_LEVEL = np.zeros((3, 1, 1))
EXAMPLE = (
    Clip(Path(), FileNumber(0, 0), 0.0, 0.0),
    dict.fromkeys(("min", "max", "mean", "std", "q01", "q10", "q50", "q90", "q99"), _LEVEL)
    | {"count": np.ones(1, np.int64)},
)


def stage_videos(
    dataset: Dataset, episodes: Sequence[Path], rows: Sequence[dict[str, Any]], stage: Stage
) -> dict[str, Any]:
    """Write the new video files, and add to the episodes' rows what is said about them.

    Returns:
        Camera -> statistics of all pictures of the dataset, where those of the old ones are known.

    Raises:
        DatasetError: an image of the journal is damaged.
    """
    found = {}
    total = sum(row["length"] for row in rows) * len(dataset.next_video_files)
    with _bar(total) as progress:
        for camera in dataset.next_video_files:
            parts = _stage_camera(dataset, camera, episodes, rows, stage, progress)
            whole = _of_all(dataset, camera, parts)
            if whole is not None:
                found[camera] = {name: values.tolist() for name, values in whole.items()}
    return found


def camera_columns(camera: str, clip: Clip, found: Found) -> dict[str, Any]:
    """Return what an episode's row in `meta/episodes` says about its pictures."""
    values = (*clip.number, clip.start, clip.stop)
    pointers = zip(POINTERS, values, strict=True)
    return {f"videos/{camera}/{name}": value for name, value in pointers} | {
        f"stats/{camera}/{name}": values.tolist() for name, values in found.items()
    }


def described_videos(dataset: Dataset) -> dict[str, Any]:
    """Return what `meta/info.json` says about videos, where LeRobot left it open."""
    info, cameras = dataset.info, dataset.next_video_files
    if not cameras:
        return {}
    features = {
        name: {"info": video_details(entry["shape"], info["fps"])} | entry
        if name in cameras and "video_info" not in entry
        else entry
        for name, entry in info["features"].items()
    }
    return {"features": features, "video_path": info.get("video_path") or VIDEO_PATH}


def _stage_camera(
    dataset: Dataset,
    camera: str,
    episodes: Sequence[Path],
    rows: Sequence[dict[str, Any]],
    stage: Stage,
    progress: Callable[[int], object],
) -> list[Found]:
    """Write a camera's new files, and return the statistics of each new episode."""
    from pacnet.datasets.journal.video_files import VideoFiles  # which imports numba

    entry, parts = dataset.info["features"][camera], []
    with VideoFiles(
        dataset.info,
        Picture(*entry["shape"][:2]),
        entry,
        dataset.next_video_files[camera],
        lambda number: stage.add(video_path(dataset.info, camera, number)),
    ) as files:
        for path, row in zip(episodes, rows, strict=True):
            images = read_episode(path)[2][camera]
            clip, found = files.add([image.as_py() for image in images])
            row |= camera_columns(camera, clip, found)
            parts.append(found)
            progress(len(images))
    return parts


def _of_all(dataset: Dataset, camera: str, parts: list[Found]) -> Found | None:
    """Return the statistics of old and new pictures; None if those of the old are not known."""
    if dataset.info["total_frames"]:
        try:
            stored = json.loads((dataset.root / STATISTICS).read_text(encoding="utf-8"))[camera]
        except (OSError, ValueError, RecursionError, KeyError, TypeError):
            return None
        old = checked(camera, stored, dataset.info["total_frames"])
        if old is None:
            return None
        parts = [old, *parts]
    return joined(parts)


@contextmanager
def _bar(total: int) -> Iterator[Callable[[int], object]]:
    """Show how many pictures of all are encoded, if it takes time; nothing outside a terminal."""
    from tqdm import tqdm

    with tqdm(
        total=total, desc="encoding videos", unit="frame", disable=None, leave=False, delay=_SLOW
    ) as bar:
        yield bar.update
