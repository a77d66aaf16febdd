"""Pictures of cameras: those of a batch while acting, those of a dataset's files while learning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format.episodes import read_episodes
from pacnet.datasets.format.info import image_features, read_info

Pictures = dict[str, NDArray[np.uint8]]
"""Camera -> its picture `[H, W, 3]`, or its pictures `[T, H, W, 3]`."""


def pictures_of(
    batch: Mapping[str, Any], cameras: Sequence[str], looking: Sequence[bool]
) -> list[Pictures]:
    """Return the pictures of each row of a batch that is looked at; none of others.

    Args:
        batch: with pictures as LeRobot gives them: float `[B, 3, H, W]` from 0 to 1; or uint8, also
            `[B, H, W, 3]`.
        cameras: the features to look at.
        looking: whether the pictures of a row are looked at, `[B]`; converting them takes
            milliseconds each.

    Raises:
        ValueError: a camera is missing, or its pictures are of another shape, dtype or range.
    """
    pictures: list[Pictures] = [{} for _ in looking]
    if not any(looking):
        return pictures
    for name in cameras:
        for row, picture in _column(batch, name, looking).items():
            pictures[row][name] = picture
    return pictures


def _column(
    batch: Mapping[str, Any], name: str, looking: Sequence[bool]
) -> dict[int, NDArray[np.uint8]]:
    """Return row -> the picture `[H, W, 3]` of one camera, of the rows that are looked at."""
    if name not in batch:
        raise ValueError(
            f"expected the picture {name!r} in the batch, got {', '.join(map(str, batch))}"
        )
    given = batch[name]
    expected = f"expected {name!r} of shape [{len(looking)}, 3, height, width]"
    if not isinstance(given, Tensor) or given.dim() < 3 or 0 in given.shape:
        got = [*given.shape] if isinstance(given, Tensor) else type(given).__name__
        raise ValueError(f"{expected}, got {got}")
    pictures = given.detach().reshape(-1, *given.shape[-3:])  # there may be an axis for time
    if pictures.shape[1] == 3:
        pictures = pictures.permute(0, 2, 3, 1)
    if len(pictures) != len(looking) or pictures.shape[3] != 3:
        raise ValueError(f"{expected}, got {[*given.shape]}")
    return {
        row: _bytes(name, pictures[row]).cpu().contiguous().numpy()
        for row, looks in enumerate(looking)
        if looks
    }


def _bytes(name: str, picture: Tensor) -> Tensor:
    """Return a picture as uint8."""
    if picture.dtype == torch.uint8:
        return picture
    low, high = (float(value) for value in picture.aminmax())
    if not picture.dtype.is_floating_point or not (low >= 0 and high <= 1):
        raise ValueError(
            f"expected {name!r} as uint8, or as float from 0 to 1, got {picture.dtype} from "
            f"{low:g} to {high:g}"
        )
    return (picture * 255).round_().to(torch.uint8)


class DatasetPictures:
    """What cameras show of a dataset's episodes.

    They are read from its files, in order: batches come shuffled, and in full size.

    Args:
        root: the dataset's folder.
        cameras: their features.
        named: whether they were asked for by name. One that cannot be read is left out with a
            warning where these are all cameras and none was named; else it is refused.

    Raises:
        DatasetError: the dataset cannot be read, or lacks a camera.
    """

    def __init__(self, root: str | Path, cameras: Sequence[str], named: bool) -> None:
        # It imports numba, of which LeRobot's commands need nothing before they learn or act.
        from pacnet.datasets.pictures.camera_choice import ALL, choose_cameras

        info = read_info(Path(root))
        every = not named and {*choose_cameras(info, cameras)} == {*image_features(info)}
        self._root, self._cameras = root, ALL if every else cameras
        there = read_episodes(Path(root), info, ())
        self._lengths = dict(zip(there.indices, there.lengths, strict=True))
        self._first = dict(zip(there.indices, accumulate(there.lengths, initial=0), strict=False))
        self._known: dict[int, Mapping[str, NDArray[np.uint8]]] = {}

    def read(self, episodes: Sequence[int]) -> None:
        """Read the pictures of episodes, unless they are known.

        Raises:
            ValueError: the files have no such episode.
            DatasetError: pictures cannot be read.
        """
        unknown = [one for one in episodes if one not in self._known]
        lacking = [one for one in unknown if one not in self._lengths]
        if lacking:
            raise ValueError(
                f"expected pictures of episode {lacking[0]}, the dataset's files lack it"
            )
        if unknown:
            shown = load_demonstrations(
                self._root,
                state=None,
                environment_state=None,
                action=None,
                cameras=self._cameras,
                episodes=unknown,
            )
            self._known |= {one.episode: one.pictures for one in shown}

    def of_frames(self, episode: int, index: Tensor) -> Mapping[str, NDArray[np.uint8]]:
        """Return the pictures of some frames of an episode that was read, by camera.

        Args:
            episode: its number.
            index: of the frames in the dataset, ascending, `[T]`.

        Raises:
            ValueError: the episode has no such frames.
        """
        frames, length = index.numpy() - self._first[episode], self._lengths[episode]
        if frames[0] < 0 or frames[-1] >= length:
            raise ValueError(f"expected {length} frames in episode {episode}, got others")
        return {
            name: rows if len(frames) == length else rows[frames]
            for name, rows in self._known[episode].items()
        }
