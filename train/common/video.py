"""Write frames as a video, MP4 (H.264, by PyAV) or GIF (by Pillow), atomically."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image


def write_mp4(frames: Iterable[NDArray[np.uint8]], path: str | Path, fps: float) -> Path:
    """Write an MP4 that browsers play (H.264, yuv420p).

    Args:
        frames: Pictures `[H, W, 3]`, read one at a time; H and W even, as yuv420p requires.
        path: Of the file, in an existing folder; a file there is replaced at the end.
        fps: Frames a second [1/s].

    Returns:
        The path.

    Raises:
        ValueError: No frames, frames of another dtype, shape or odd size, or a bad `fps`.
    """
    rate = _rate(fps)
    with _replacing(Path(path)) as unfinished, av.open(unfinished, "w", format="mp4") as file:
        stream = file.add_stream("libx264", rate=rate)
        stream.pix_fmt = "yuv420p"
        for frame in _checked(frames, multiple=2):
            stream.height, stream.width = frame.shape[:2]
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        file.mux(stream.encode())
    return Path(path)


def write_gif(frames: Iterable[NDArray[np.uint8]], path: str | Path, fps: float) -> Path:
    """Write a GIF that repeats forever.

    GIF counts time in steps of 10 ms; a frame equal to the one before prolongs it.

    Args:
        frames: Pictures `[H, W, 3]`, read one at a time.
        path: Of the file, in an existing folder; a file there is replaced at the end.
        fps: Frames a second, at most 50; viewers play faster GIFs slowly [1/s].

    Returns:
        The path.

    Raises:
        ValueError: No frames, frames of another dtype or shape, or a bad `fps`.
    """
    rate = _rate(fps)
    if rate > 50:
        raise ValueError(f"expected fps up to 50 for a GIF, got {fps}")
    pictures = (  # the octree is 60 times faster than Pillow's default, with similar colours
        Image.fromarray(frame).quantize(method=Image.Quantize.FASTOCTREE)
        for frame in _checked(frames, multiple=1)
    )
    with _replacing(Path(path)) as unfinished, unfinished.open("w+b") as file:
        next(pictures).save(
            file,
            format="GIF",
            save_all=True,
            append_images=pictures,
            duration=float(1000 / rate),  # [ms]
            loop=0,
        )
    return Path(path)


def _rate(fps: float) -> Fraction:
    """Return frames a second as the fraction that video formats use, or raise a ValueError."""
    if not 0.01 <= fps <= 1000:
        raise ValueError(f"expected fps from 0.01 to 1000, got {fps}")
    return Fraction(fps).limit_denominator(1001)


def _checked(frames: Iterable[NDArray[np.uint8]], multiple: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames, all of the size of the first; raise a ValueError for a bad one or none."""
    shape = None
    for count, frame in enumerate(frames):
        array = np.asarray(frame)
        shape = array.shape if shape is None else shape
        if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape:
            raise ValueError(
                f"expected frame {count} as uint8 [H, W, 3], got {array.dtype} {array.shape}"
            )
        if array.shape != shape:
            raise ValueError(f"expected frame {count} as {shape} like the first, got {array.shape}")
        if shape[0] % multiple or shape[1] % multiple:
            raise ValueError(f"expected an even height and width, got {shape[0]} x {shape[1]}")
        yield np.ascontiguousarray(array)
    if shape is None:
        raise ValueError("expected one or more frames, got none")


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` at the end, or is removed on an error."""
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
