"""Where the videos of a dataset to be copied are, and which part of a file shows an episode."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from pacnet.core.lfs import is_lfs_pointer
from pacnet.datasets.copying.source import Source
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.appending import FileNumber
from pacnet.datasets.format.info import image_features
from pacnet.datasets.format.paths import check_video_path, path_of_source
from pacnet.datasets.format.tables import read_episode_rows

_POINTERS = ("chunk_index", "file_index", "from_timestamp", "to_timestamp")
_DEFAULT_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_EPISODE_FILE = re.compile(r"episode_([0-9]{1,9})\.mp4")
_NO_VIDEOS = "copy the dataset without its videos (--no-videos), or bring them"
_NAMED = 3  # files in a message


class Clip(NamedTuple):
    """The part of a video file that shows an episode."""

    path: Path  # of the source
    number: FileNumber  # in the copy
    start: float  # [s]
    stop: float  # [s]


class Cameras(NamedTuple):
    """The videos of a copy.

    Attributes:
        clips: camera -> the clip of each episode.
        left_out: camera -> why it is left out.
    """

    clips: Mapping[str, list[Clip]] = MappingProxyType({})
    left_out: Mapping[str, str] = MappingProxyType({})


def find_videos(source: Source) -> Cameras:
    """Find and check the video files of the source's episodes.

    Raises:
        DatasetError: some of a camera's files are missing, one is a link out of the dataset or a
            Git LFS pointer, or they cannot be read.
    """
    cameras = image_features(source.info, "video")
    if not cameras:
        return Cameras()
    check_video_path("videos/{video_key}", cameras)
    find = _clips_v2 if source.is_old else _clips_v3
    found: dict[str, list[Clip]] = {}
    left_out = {}
    for camera, clips in find(source, cameras).items():
        missing = [clip for clip in clips if clip is None or not _is_there(source.root, clip.path)]
        if len(missing) == len(clips):
            left_out[camera] = "none of its video files is there"
        else:
            _check_complete(source, camera, clips)
            found[camera] = _renumbered([clip for clip in clips if clip is not None])
    return Cameras(found, left_out)


def _is_there(root: Path, path: Path) -> bool:
    """Return whether a video file has content, after checking where its links lead."""
    path = path_of_source(root, path.relative_to(root).as_posix())
    return path.is_file() and path.stat().st_size > 0


def _check_complete(source: Source, camera: str, clips: Sequence[Clip | None]) -> None:
    missing = []
    for episode, clip in zip(source.episodes, clips, strict=True):
        if clip is None or not _is_there(source.root, clip.path):
            missing.append(f"episode {episode.number}" if clip is None else str(clip.path))
        elif is_lfs_pointer(clip.path):
            raise DatasetError(
                f"{clip.path} is a pointer of Git LFS in place of a video: "
                f"run `git lfs pull` in {source.root}"
            )
    missing = [*dict.fromkeys(missing)]
    if missing:
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        raise DatasetError(
            f"expected all video files of {camera!r}, {', '.join(missing[:_NAMED])}{more} missing: "
            f"{_NO_VIDEOS}"
        )


def _renumbered(clips: list[Clip]) -> list[Clip]:
    """Return clips whose last file has the highest number, behind which LeRobot appends."""
    last_uses = {clip.path: at for at, clip in enumerate(clips)}
    numbers = {clip.path: clip.number for clip in clips}
    in_order = [numbers[path] for path in sorted(last_uses, key=last_uses.__getitem__)]
    if max(in_order) == in_order[-1] and len({*in_order}) == len(in_order):
        return clips
    paths = sorted(last_uses, key=last_uses.__getitem__)
    fresh = dict(zip(paths, sorted({*in_order}), strict=True))
    return [clip._replace(number=fresh[clip.path]) for clip in clips]


def _clips_v3(source: Source, cameras: Sequence[str]) -> dict[str, list[Clip | None]]:
    """Return each camera's clips as `meta/episodes` has them; those of videos it lacks are None."""
    template = source.info.get("video_path") or _DEFAULT_PATH
    check_video_path(template, [*cameras])
    columns = [f"videos/{camera}/{name}" for camera in cameras for name in _POINTERS]
    rows = {row["episode_index"]: row for row in read_episode_rows(source.root, columns)}
    found: dict[str, list[Clip | None]] = {camera: [] for camera in cameras}
    for camera, episode in ((camera, one.number) for camera in cameras for one in source.episodes):
        pointers = [rows.get(episode, {}).get(f"videos/{camera}/{name}") for name in _POINTERS]
        found[camera].append(_clip_v3(source.root, template, camera, episode, pointers))
    return found


def _clip_v3(
    root: Path, template: str, camera: str, episode: int, pointers: list[Any]
) -> Clip | None:
    if None in pointers:
        return None
    chunk, file, start, stop = pointers
    whole = all(isinstance(number, int) and 0 <= number < 2**31 for number in (chunk, file))
    if not whole or not 0 <= start <= stop < math.inf:
        raise DatasetError(
            f"{root}/meta/episodes: expected the video of {camera!r} as chunk, file, from and to, "
            f"found {pointers} in episode {episode}"
        )
    path = template.format(video_key=camera, chunk_index=chunk, file_index=file)
    return Clip(path_of_source(root, path), FileNumber(chunk, file), float(start), float(stop))


def _clips_v2(source: Source, cameras: Sequence[str]) -> dict[str, list[Clip | None]]:
    """Return each camera's clips: one file an episode, wherever the chunks begin."""
    found: dict[str, list[Clip | None]] = {}
    for camera in cameras:
        files = dict(_files_v2(source.root, camera))
        found[camera] = []
        for at, episode in enumerate(source.episodes):
            path, duration = files.get(episode.number), episode.length / source.info["fps"]
            number = FileNumber(*divmod(at, chunks_size(source.info)))
            found[camera].append(None if path is None else Clip(path, number, 0.0, duration))
    return found


def chunks_size(info: Mapping[str, Any]) -> int:
    """Return the number of files in a chunk; LeRobot's own where it is not a sound one."""
    size = info.get("chunks_size")
    return size if type(size) is int and 0 < size < 2**31 else 1000


def _files_v2(root: Path, camera: str) -> Iterator[tuple[int, Path]]:
    """Yield the episode and the path of each of a camera's files."""
    for folder in sorted((root / "videos").glob("*/")):
        if (folder / camera).is_dir():
            for path in sorted((folder / camera).iterdir()):
                match = _EPISODE_FILE.fullmatch(path.name)
                if match:
                    yield int(match[1]), path
