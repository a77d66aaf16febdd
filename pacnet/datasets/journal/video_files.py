"""New video files of a camera, encoded from the pictures of a journal by PyAV.

An episode begins where the one before ends. After a full file another is begun.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.clips import Clip
from pacnet.datasets.format.features import Picture
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.info import ALL_COLOURS, SMALL, SOME_COLOURS
from pacnet.datasets.format.shades import Found, Shades
from pacnet.datasets.pictures.decoders import import_decoder
from pacnet.datasets.pictures.image_file import decode_image

# A key frame in every second frame, as LeRobot has it, to read frames in any order.
_OPTIONS = {"g": "2", "crf": "18"}
# Of small pictures nothing is averaged away afterwards, and an object of a few pixels is lost.
_SMALL_OPTIONS = {"g": "2", "crf": "10"}
_AV1_OPTIONS = {"g": "2", "crf": "30", "preset": "10"}
_COUNTED = 100  # frames of an episode, at most, whose shades are counted
_MEGABYTES = 200  # of a file, where the dataset does not say it


class VideoFiles(AbstractContextManager["VideoFiles"]):
    """Writer of the new video files of one camera."""

    def __init__(
        self,
        info: Mapping[str, Any],
        picture: Picture,
        entry: Mapping[str, Any],
        first: FileNumber,
        place: Callable[[FileNumber], Path],
    ) -> None:
        """Begin with no file.

        Args:
            info: description of the dataset.
            picture: size of the pictures.
            entry: the camera's part of the description; new files get the codec and the
                colours of the old ones.
            first: number of the first new file.
            place: called with a file's number, returns where to write it.
        """
        self._av: Any = import_decoder("av")
        self._info, self._picture, self._place, self._number = info, picture, place, first
        details = entry.get("info") or entry.get("video_info") or {}
        self._is_av1 = details.get("video.codec") == "av1"
        keeps_all = details.get("video.pix_fmt") == ALL_COLOURS and not self._is_av1
        self._colours = ALL_COLOURS if keeps_all else SOME_COLOURS
        self._rate = Fraction(info["fps"]).limit_denominator(10**6)
        self._path: Path | None = None
        self._frames = 0  # of the open file

    def add(self, images: Sequence[bytes]) -> tuple[Clip, Found]:
        """Append an episode; return where it is, and the statistics of its pictures.

        Raises:
            DatasetError: an image is no PNG, or of another size.
        """
        if self._path is not None and self._is_full(self._path):
            self.close()
            self._number = self._number.next(self._info["chunks_size"])
        if self._path is None:
            self._path = self._place(self._number)
            self._open(self._path)
        start, shades = self._frames, Shades()
        counted = {*np.linspace(0, len(images) - 1, min(len(images), _COUNTED)).round().tolist()}
        for number, content in enumerate(images):
            picture = self._decoded(content)
            if number in counted:
                shades.add(picture)
            self._encode(picture)
        fps = self._info["fps"]
        clip = Clip(self._path, self._number, start / fps, self._frames / fps)
        return clip, shades.statistics()

    def close(self) -> None:
        """Complete the file that is open, and wait until it is on the disk."""
        if self._path is None:
            return
        self._container.mux(self._stream.encode())
        self._container.close()
        with self._path.open("rb") as file:
            os.fsync(file.fileno())
        self._path = None

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Complete the open file, unless there was an error."""
        if kind is None:
            self.close()
        elif self._path is not None:
            self._container.close()

    def _is_full(self, path: Path) -> bool:
        size = self._info.get("video_files_size_in_mb", _MEGABYTES)
        return path.stat().st_size > size * 2**20

    def _open(self, path: Path) -> None:
        if self._is_av1:
            os.environ.setdefault("SVT_LOG", "1")  # errors alone
        self._container = self._av.open(f"file:{path}", "w", format="mp4")
        name = "libsvtav1" if self._is_av1 else "libx264"
        small = max(self._picture.height, self._picture.width) <= SMALL
        h264 = _SMALL_OPTIONS if small else _OPTIONS
        options = _AV1_OPTIONS if self._is_av1 else h264
        self._stream = self._container.add_stream(name, self._rate, options)
        self._stream.height, self._stream.width = self._picture.height, self._picture.width
        self._stream.pix_fmt = self._colours
        self._frames = 0

    def _decoded(self, content: bytes) -> NDArray[np.uint8]:
        picture = decode_image(content)
        if picture.shape != self._picture.shape:
            raise DatasetError(
                f"expected pictures of shape {[*self._picture.shape]} in the journal, found "
                f"{[*picture.shape]}"
            )
        return picture

    def _encode(self, picture: NDArray[np.uint8]) -> None:
        frame = self._av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.pts, frame.time_base = self._frames, 1 / self._rate
        self._frames += 1
        self._container.mux(self._stream.encode(frame))
