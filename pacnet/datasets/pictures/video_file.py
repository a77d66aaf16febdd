"""A video file decoded in sequence by PyAV; frames are found by their time.

The file may come from anywhere: it is read as MP4 and as nothing else, since FFmpeg also follows
playlists, to other files and into the network. A frame that cannot be decoded is left out; the
episode that lacks it is then the damaged one, also in a file that shows several.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format import DatasetError, unreadable
from pacnet.datasets.pictures.decoders import import_decoder
from pacnet.datasets.pictures.footage import DepthPictures, Pictures
from pacnet.datasets.pictures.reducing import LARGEST_SIDE, reduce

_SKIPPED = 1.0  # s that are decoded in passing; farther ahead it is searched for
_EIGHT_BITS = 8


class VideoFile:
    """An open video file."""

    def __init__(self, path: Path) -> None:
        """Open a file.

        Raises:
            MissingDecoder: PyAV is not installed.
            DatasetError: the file cannot be read or decoded.
        """
        self._av, self._path, self._problem = import_decoder("av"), path, ""
        self._open()

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    def frames(self, start: float, length: int, fps: float) -> Iterator[tuple[int, Pictures]]:
        """Yield the number of each frame of a clip that is there, and its picture.

        A frame belongs to the nearest moment at which one is expected.

        Args:
            start: time of the clip's first frame [s].
            length: number of its frames.
            fps: frames per second [1/s].

        Raises:
            DepthPictures: it shows distances.
            DatasetError: the file cannot be searched, a frame cannot be decoded, or is too large.
        """
        nearest = np.full(length, np.inf)
        yield from self._nearer(nearest, start, fps)
        if self._problem and not np.isfinite(nearest).all():
            raise unreadable(self._path, self._problem)

    def _open(self) -> None:
        """Open the file at its beginning."""
        try:
            self._container = self._av.open(
                f"file:{self._path}",
                format="mp4",
                options={"protocol_whitelist": "file"},
                metadata_errors="ignore",
            )
        except (self._av.FFmpegError, OSError) as error:
            raise unreadable(self._path, error) from error
        try:
            self._stream = self._checked_stream()
        except BaseException:
            self.close()
            raise
        # A decoder's thread that writes to PyAV's log waits for Python's lock, which `close` holds
        # while it waits for the thread. Threads also lose sound frames beside a damaged one.
        self._stream.thread_type = "NONE"
        self._stream.codec_context.thread_count = 1
        self._base = float(self._stream.time_base)  # s
        self._begin = (self._stream.start_time or 0) * self._base  # s
        self._decoded, self._problem = self._decode(), ""
        self._ahead: tuple[float, Any] | None = None  # decoded for the next clip
        self._time = 0.0  # s, of the last frame

    def _nearer(
        self, nearest: NDArray[np.float64], start: float, fps: float
    ) -> Iterator[tuple[int, Pictures]]:
        """Yield frames that are nearer to their moments than those before, and say how near."""
        for time, frame in self._from(start, 1 / fps):
            place = (time - start) * fps
            number = round(place)
            if number >= len(nearest):
                self._ahead = time, frame
                return
            if number >= 0 and abs(place - number) < nearest[number]:
                nearest[number] = abs(place - number)
                yield number, self._picture(frame)

    def _checked_stream(self) -> Any:
        """Return the stream of pictures."""
        streams = self._container.streams.video
        if not streams:
            raise unreadable(self._path, "it holds no video")
        context = streams[0].codec_context
        if context is None:
            raise unreadable(self._path, "no decoder for its codec is installed")
        if context.format is None or not context.width:
            raise unreadable(self._path, f"no picture of its codec {context.name} can be decoded")
        return streams[0]

    def _from(self, start: float, step: float) -> Iterator[tuple[float, Any]]:
        """Yield the times [s] of frames, and these, from one before a time."""
        if not start - _SKIPPED <= self._time <= start + step / 2:
            try:
                at = int((start - step / 2 + self._begin) / self._base)
                self._container.seek(max(0, at), stream=self._stream)
            except (self._av.FFmpegError, OSError, OverflowError) as error:
                raise unreadable(self._path, error) from error
            self._decoded, self._ahead, self._problem = self._decode(), None, ""
        if self._ahead is not None:
            yield self._ahead
            self._ahead = None
        for frame in self._decoded:
            if frame.time is not None and not frame.is_corrupt:
                self._time = frame.time - self._begin
                yield self._time, frame

    def _decode(self) -> Iterator[Any]:
        """Yield the frames that can be decoded."""
        try:
            for packet in self._container.demux(self._stream):
                try:
                    yield from packet.decode()
                except self._av.FFmpegError as error:
                    self._problem = str(error)
        except (self._av.FFmpegError, OSError) as error:
            self._problem = str(error)

    def _picture(self, frame: Any) -> Pictures:
        """Return a frame as a reduced picture."""
        if max(frame.width, frame.height) > LARGEST_SIDE:
            raise DatasetError(
                f"{self._path}: expected sides up to {LARGEST_SIDE} pixels, found "
                f"{frame.width}x{frame.height}"
            )
        channels = frame.format.components
        if len(channels) == 1 and channels[0].bits > _EIGHT_BITS:
            raise DepthPictures(f"{self._path} shows distances ({frame.format.name})")
        return reduce(frame.to_ndarray(format="rgb24"))
