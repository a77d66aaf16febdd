"""The pictures of a dataset's cameras, and what is left out where they are damaged or missing."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.episodes import Episodes
from pacnet.datasets.format.numbers import episodes_text, numbers_text
from pacnet.datasets.pictures.cache import PictureCache
from pacnet.datasets.pictures.camera_choice import ALL, CameraChoice, choose_cameras, shows_depth
from pacnet.datasets.pictures.decoders import MissingDecoder
from pacnet.datasets.pictures.footage import (
    DepthPictures,
    Footage,
    MissingPictures,
    Pictures,
    size_text,
)
from pacnet.datasets.pictures.image_column import ImageColumn
from pacnet.datasets.pictures.videos import Videos

_SLOW = 2  # s, after which a bar shows how far it is


class Seen(NamedTuple):
    """The pictures of E episodes."""

    of_episodes: list[dict[str, Pictures]]  # [E], camera -> [T, H, W, 3]
    damaged: set[int]  # indices of the episodes that are to be left out


class _Camera(NamedTuple):
    """What one camera shows."""

    footage: Callable[[int], Footage | None]  # of an episode by its place, or a DatasetError
    source: Videos | ImageColumn


def read_pictures(
    root: Path,
    info: Mapping[str, Any],
    cameras: CameraChoice,
    read: Episodes,
    fps: float,
    skip_damaged: bool,
) -> Seen:
    """Decode and reduce what cameras show of these episodes, with a progress bar.

    Args:
        root: the dataset's folder.
        info: its description.
        cameras: those asked for.
        read: the episodes.
        fps: frames per second [1/s].
        skip_damaged: whether episodes with pictures that cannot be read are left out with a
            `DatasetWarning` rather than refused.

    Raises:
        DatasetError: a camera or its pictures cannot be read, or PyAV or Pillow is not installed.
    """
    chosen = choose_cameras(info, cameras)
    seen = Seen([{} for _ in read.indices], set())
    if not chosen:
        return seen
    with _bar(len(chosen) * len(read.rows)) as progress, closing(PictureCache()) as cache:
        for name in chosen:
            try:
                if shows_depth(info, name):
                    raise DepthPictures("it measures distances")
                camera = _camera(root, info, name, read, fps)
                found, broken = _decode(camera, read, cache, progress)
            except (DepthPictures, MissingPictures) as error:
                _leave_out_camera(name, error, is_named=cameras != ALL)
                continue
            broken |= _other_sizes(found, read)
            if len(broken) == len(read.indices) and skip_damaged:
                _leave_out_camera(name, next(iter(broken.values())), is_named=cameras != ALL)
                continue
            _report(name, read, found, broken, skip_damaged)
            seen.damaged.update(broken)
            for place, pictures in found.items():
                seen.of_episodes[place][name] = pictures
    return seen


def _camera(root: Path, info: Mapping[str, Any], name: str, read: Episodes, fps: float) -> _Camera:
    if info["features"][name]["dtype"] == "video":
        videos = Videos(root, info, name, fps)
        return _Camera(
            lambda place: videos.footage(read.indices[place], read.lengths[place]), videos
        )
    column, rows = ImageColumn(root, name, read.files), read.split(read.rows)
    return _Camera(lambda place: column.footage(rows[place]), column)


def _decode(
    camera: _Camera, read: Episodes, cache: PictureCache, progress: Callable[[int], object]
) -> tuple[dict[int, Pictures], dict[int, DatasetError]]:
    """Return the pictures of episodes by their places, and why others by their indices have none.

    Raises:
        DepthPictures: the camera measures distances.
        MissingDecoder: PyAV or Pillow is not installed.
        MissingPictures: none of its files is there.
    """
    found: dict[int, Pictures] = {}
    broken: dict[int, DatasetError] = {}
    with closing(camera.source):
        for place, episode in enumerate(read.indices):
            try:
                footage = camera.footage(place)
                if footage is not None:
                    found[place] = cache.pictures(footage, progress)
            except (DepthPictures, MissingDecoder):
                raise
            except DatasetError as error:
                broken[episode] = error
    if not found and all(isinstance(error, MissingPictures) for error in broken.values()):
        raise MissingPictures("none of its files is there")
    return found, broken


def _other_sizes(found: dict[int, Pictures], read: Episodes) -> dict[int, DatasetError]:
    """Take away the episodes with pictures of another size than most, and return why."""
    sizes = Counter(size_text(pictures) for pictures in found.values())
    if len(sizes) < 2:
        return {}
    usual = sizes.most_common(1)[0][0]
    others = {place: size_text(one) for place, one in found.items() if size_text(one) != usual}
    for place in others:
        del found[place]
    return {
        read.indices[place]: DatasetError(
            f"expected pictures of {usual} after they are reduced, as in other episodes, found "
            f"{size}"
        )
        for place, size in others.items()
    }


def _leave_out_camera(camera: str, error: DatasetError, is_named: bool) -> None:
    """Say that a camera is left out; refuse to if it was asked for by name."""
    if is_named:
        raise DatasetError(f"the camera {camera!r} cannot be read: {error}") from error
    warnings.warn(f"left out the camera {camera!r}: {error}", DatasetWarning, stacklevel=4)


def _report(
    camera: str,
    read: Episodes,
    found: Mapping[int, Pictures],
    broken: Mapping[int, DatasetError],
    skip_damaged: bool,
) -> None:
    """Name the episodes that the camera lacks, and those that are left out, or refuse these."""
    if broken:
        about = f"the pictures of {camera!r} in {episodes_text([*broken])} cannot be read: "
        about += str(next(iter(broken.values())))
        if not skip_damaged:
            raise DatasetError(
                f"{about}: read the others with --skip-damaged (skip_damaged=True in Python), or "
                f"leave out what is damaged with --exclude {numbers_text([*broken])}"
            )
        _warn(f"left out ({episodes_text([*broken])}): {about}")
    lacking = [
        episode
        for place, episode in enumerate(read.indices)
        if place not in found and episode not in broken
    ]
    if lacking:
        _warn(f"the camera {camera!r} is not in {episodes_text(lacking)}")


def _warn(text: str) -> None:
    warnings.warn(text, DatasetWarning, stacklevel=5)


@contextmanager
def _bar(total: int) -> Iterator[Callable[[int], object]]:
    """Show how many pictures of all are decoded, if it takes time; nothing outside a terminal."""
    from tqdm import tqdm

    with tqdm(
        total=total, desc="decoding pictures", unit="frame", disable=None, leave=False, delay=_SLOW
    ) as bar:
        yield bar.update
