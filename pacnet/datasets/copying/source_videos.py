"""Where the videos of a dataset to be copied are, and which part of a file shows an episode."""

from collections.abc import Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import Any, NamedTuple

from pacnet.core.lfs import is_lfs_pointer
from pacnet.datasets.copying.source import Source
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.clips import Clip, Clips, has_content
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.info import image_features

_NO_VIDEOS = "copy the dataset without its videos (--no-videos), or bring them"
_NAMED = 3  # files in a message


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
    found: dict[str, list[Clip]] = {}
    left_out = {}
    for camera, clips in _clips(source, cameras).items():
        missing = [
            clip for clip in clips if clip is None or not has_content(source.root, clip.path)
        ]
        if len(missing) == len(clips):
            left_out[camera] = "none of its video files is there"
        else:
            _check_complete(source, camera, clips)
            found[camera] = _renumbered([clip for clip in clips if clip is not None])
    return Cameras(found, left_out)


def _check_complete(source: Source, camera: str, clips: Sequence[Clip | None]) -> None:
    missing = []
    for episode, clip in zip(source.episodes, clips, strict=True):
        if clip is None or not has_content(source.root, clip.path):
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


def _clips(source: Source, cameras: Sequence[str]) -> dict[str, list[Clip | None]]:
    """Return each camera's clips; None where an episode has none."""
    clips, size = Clips(source.root, source.info, cameras), chunks_size(source.info)
    found: dict[str, list[Clip | None]] = {camera: [] for camera in cameras}
    for camera, (at, episode) in product(cameras, enumerate(source.episodes)):
        clip = clips.clip(camera, episode.number, episode.length / source.info["fps"])
        if clip is not None and source.is_old:  # the files are numbered anew
            clip = clip._replace(number=FileNumber(*divmod(at, size)))
        found[camera].append(clip)
    return found


def chunks_size(info: Mapping[str, Any]) -> int:
    """Return the number of files in a chunk; LeRobot's own where it is not a sound one."""
    size = info.get("chunks_size")
    return size if type(size) is int and 0 < size < 2**31 else 1000
