"""What one camera shows of one episode, and its pictures gathered frame by frame."""

from collections.abc import Callable, Hashable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format import DatasetError

Pictures = NDArray[np.uint8]
"""Reduced pictures `[T, H, W, 3]`, or one of them `[H, W, 3]`."""


class MissingPictures(DatasetError):  # noqa: N818 — it is a kind of DatasetError
    """The file of an episode's pictures is missing or empty."""


class DepthPictures(DatasetError):  # noqa: N818 — it is a kind of DatasetError
    """Pictures of distances in place of colours."""


class Footage(NamedTuple):
    """What one camera shows of one episode.

    Attributes:
        length: number of the episode's frames.
        key: what the pictures depend on.
        frames: decodes them: yields the number of a frame and its reduced picture `[H, W, 3]`, of
            some frames perhaps several, the best one last. It raises a `DatasetError` where it
            cannot go on.
        is_lasting: whether the key, as known once they are decoded, is all that they depend on.
    """

    length: int
    key: tuple[Hashable, ...]
    frames: Callable[[], Iterator[tuple[int, Pictures]]]
    is_lasting: Callable[[], bool] = lambda: True


def gather(footage: Footage, progress: Callable[[int], object]) -> Pictures:
    """Return the pictures of all frames of an episode.

    Args:
        footage: what is shown.
        progress: called with 1 for each picture.

    Raises:
        DatasetError: they cannot be decoded, are of several sizes, or some are missing.
    """
    pictures, found = None, np.zeros(footage.length, np.bool_)
    for frame, picture in footage.frames():
        if pictures is None:
            pictures = np.empty((footage.length, *picture.shape), np.uint8)
        if picture.shape != pictures.shape[1:]:
            raise DatasetError(
                f"expected pictures of one size, found {size_text(picture)} after "
                f"{size_text(pictures)}"
            )
        pictures[frame] = picture
        found[frame] = True
        progress(1)
    if pictures is None or not found.all():
        raise DatasetError(
            f"expected a picture for each of its {footage.length} frames, found {found.sum()} and "
            f"none for frame {int(found.argmin())}"
        )
    return pictures


def size_text(pictures: Pictures) -> str:
    """Return the size of reduced pictures in words."""
    height, width = pictures.shape[-3:-1]
    return f"{width}x{height}"
