"""What a copy takes from a dataset, and its description, before anything is written."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pacnet.datasets.copying.kept_columns import Kept, kept_columns
from pacnet.datasets.copying.picture_statistics import picture_statistics
from pacnet.datasets.copying.source import Source, SourceEpisode, read_source
from pacnet.datasets.copying.source_videos import Cameras, chunks_size, find_videos
from pacnet.datasets.copying.write import VIDEO_PATH, Plan
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.features import (
    Arrays,
    Feature,
    Recording,
    is_text,
)
from pacnet.datasets.format.info import image_features, is_rate, json_bytes, new_info
from pacnet.datasets.format.numbers import episodes_text, numbers_text

_SIZES = ("data_files_size_in_mb", "video_files_size_in_mb")
_NOT_COPIED = ("total_chunks", "total_videos")  # of v2.0 and v2.1


class Contents(NamedTuple):
    """What a copy takes from a dataset."""

    source: Source
    kept: Kept
    cameras: Cameras

    @property
    def left_out(self) -> dict[str, str]:
        """Feature or column -> why it is left out."""
        return {**self.kept.left_out, **self.cameras.left_out}


def find_contents(
    root: Path, selected: Sequence[int] | None, *, videos: bool, skip_damaged: bool
) -> Contents:
    """Find and check what a copy takes from a dataset; no feature is read.

    Raises:
        DatasetError: the dataset cannot be read.
        ValueError: an unknown episode.
    """
    source = read_source(root, selected, skip_damaged=skip_damaged)
    fps = source.info.get("fps")
    if not is_rate(fps) or fps != int(fps):
        raise DatasetError(
            f"{root}: expected a whole number as fps in meta/info.json, found {fps!r}: "
            "write it there"
        )
    cameras = find_videos(source) if videos else Cameras()
    uneven = [one.number for one in source.episodes if _is_uneven(one, int(fps))]
    if uneven and cameras.clips:
        raise DatasetError(
            f"expected frames at every 1/{int(fps)} s, as in the videos, found others in "
            f"{episodes_text(uneven)}: copy the dataset without its videos (--no-videos), or leave "
            f"out what has them with --exclude {numbers_text(uneven)}"
        )
    if uneven:
        warnings.warn(
            f"the time of {episodes_text(uneven)} has gaps or is not that of fps: in the copy it "
            "runs evenly from 0",
            DatasetWarning,
            stacklevel=3,
        )
    return Contents(source, kept_columns(source), cameras)


def _is_uneven(episode: SourceEpisode, fps: int) -> bool:
    """Return whether frames lie elsewhere in time than in a copy, by half a frame or more.

    Some recordings count from one frame on, with videos that begin at the first; that is no matter.
    """
    times = episode.times
    if times is None or not np.isfinite(times).all():
        return False
    steps = np.arange(len(times)) / fps
    return bool(abs(times[0]) >= 1.5 / fps or (abs(times - times[0] - steps) >= 0.5 / fps).any())


def plan_copy(contents: Contents, added: Mapping[str, Feature], annotations: list[Arrays]) -> Plan:
    """Return a copy of these contents with extra columns, everything about it checked."""
    source = contents.source
    tasks = [*dict.fromkeys(task for episode in source.episodes for task in episode.tasks)]
    pictures = [
        *image_features({"features": contents.kept.features}, "image"),
        *contents.cameras.clips,
    ]
    info = _info(contents, added)
    info |= {
        "total_episodes": len(source.episodes),
        "total_frames": sum(episode.length for episode in source.episodes),
        "total_tasks": len(tasks),
        "splits": {"train": f"0:{len(source.episodes)}"},
    }
    try:
        json_bytes(info)
    except (ValueError, RecursionError) as error:
        raise DatasetError(
            f"{source.root}: expected what JSON in UTF-8 can hold in meta/info.json: {error}"
        ) from None
    found = picture_statistics(source, pictures)
    return Plan(source, info, tasks, contents.kept, contents.cameras.clips, found, annotations)


def _info(contents: Contents, added: Mapping[str, Feature]) -> dict[str, Any]:
    """Return the copy's description, with entries that only the source has."""
    old = contents.source.info
    robot = old.get("robot_type")
    recording = Recording(int(old["fps"]), dict(added), robot if is_text(robot) else None)
    new = new_info(recording)
    videos = {name: {"names": None} | old["features"][name] for name in contents.cameras.clips}
    described = contents.kept.features | videos
    features = {name: described[name] for name in old["features"] if name in described}
    sizes = {name: old[name] for name in _SIZES if is_rate(old.get(name))}
    sizes["chunks_size"] = chunks_size(old)
    more = {name: entry for name, entry in old.items() if name not in (*new, *_NOT_COPIED)}
    video_path = VIDEO_PATH if contents.cameras.clips else None
    return new | sizes | {"video_path": video_path, "features": features | new["features"]} | more
