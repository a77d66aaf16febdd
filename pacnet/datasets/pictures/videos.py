"""A camera whose pictures are in video files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.clips import Clip, Clips, has_content
from pacnet.datasets.pictures.footage import Footage, MissingPictures, Pictures
from pacnet.datasets.pictures.stamps import stamp
from pacnet.datasets.pictures.video_file import VideoFile


class Videos:
    """The video files of a camera; the last one stays open, where the next episode may begin."""

    def __init__(self, root: Path, info: Mapping[str, Any], camera: str, fps: float) -> None:
        """Find the files.

        Raises:
            DatasetError: they are outside of the dataset, or their list cannot be read.
        """
        self._root, self._camera, self._fps = root, camera, fps
        self._clips = Clips(root, info, [camera])
        self._opened: tuple[Path, VideoFile] | None = None

    def footage(self, episode: int, length: int) -> Footage | None:
        """Return what is shown of an episode, None if the camera is not in it.

        Raises:
            MissingPictures: its file is missing or empty.
            DatasetError: where its video is cannot be, or is of another length.
        """
        clip = self._clips.clip(self._camera, episode, length / self._fps)
        if clip is None:
            return None
        if not has_content(self._root, clip.path):
            raise MissingPictures(f"{clip.path} is missing or empty")
        seconds = clip.stop - clip.start
        if abs(seconds * self._fps - length) > 1:
            raise DatasetError(
                f"expected {length / self._fps:g} s of video for its {length} frames, found "
                f"{seconds:g} s listed in meta/episodes"
            )
        key = ("video", *stamp(clip.path), clip.start, length, self._fps)
        return Footage(length, key, lambda: self._frames(clip, length))

    def close(self) -> None:
        """Close the file that is open."""
        if self._opened is not None:
            self._opened[1].close()
            self._opened = None

    def _frames(self, clip: Clip, length: int) -> Iterator[tuple[int, Pictures]]:
        if self._opened is None or self._opened[0] != clip.path:
            self.close()
            self._opened = clip.path, VideoFile(clip.path)
        return self._opened[1].frames(clip.start, length, self._fps)
