"""Where the videos of a dataset are, and which part of a file shows an episode.

Formats v2.0 and v2.1 have a file for each episode; v3.0 has several episodes in a file.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.info import FORMAT_VERSION
from pacnet.datasets.format.paths import VIDEO_PATH, check_video_path, path_of_source
from pacnet.datasets.format.tables import read_episode_rows

POINTERS = ("chunk_index", "file_index", "from_timestamp", "to_timestamp")
_EPISODE_FILE = re.compile(r"episode_([0-9]{1,9})\.mp4")


class Clip(NamedTuple):
    """The part of a video file that shows an episode."""

    path: Path
    number: FileNumber  # of the file; (0, 0) in formats v2.0 and v2.1
    start: float  # [s]
    stop: float  # [s]


class Clips:
    """The clips of a dataset's cameras."""

    def __init__(self, root: Path, info: Mapping[str, Any], cameras: Sequence[str]) -> None:
        """Read where they are.

        Args:
            root: the dataset's folder.
            info: its description.
            cameras: names of features that are videos.

        Raises:
            DatasetError: videos outside of the dataset's folder, or lists that cannot be read.
        """
        check_video_path("videos/{video_key}", [*cameras])
        self._root, self._is_old = root, info["codebase_version"] != FORMAT_VERSION
        self._template = info.get("video_path") or VIDEO_PATH
        if self._is_old:
            self._files = {camera: dict(_files_v2(root, camera)) for camera in cameras}
            return
        check_video_path(self._template, [*cameras])
        columns = [f"videos/{camera}/{name}" for camera in cameras for name in POINTERS]
        self._rows = {row["episode_index"]: row for row in read_episode_rows(root, columns)}

    def clip(self, camera: str, episode: int, duration: float) -> Clip | None:
        """Return the clip of an episode; None if none is listed, or no file is named after it.

        Args:
            camera: name of the feature.
            episode: index of the episode.
            duration: of its frames [s].

        Raises:
            DatasetError: what `meta/episodes` says of it is no clip, or leads out of the dataset.
        """
        if self._is_old:
            path = self._files[camera].get(episode)
            return None if path is None else Clip(path, FileNumber(0, 0), 0.0, duration)
        row = self._rows.get(episode, {})
        pointers: list[Any] = [row.get(f"videos/{camera}/{name}") for name in POINTERS]
        if None in pointers:
            return None
        chunk, file, start, stop = pointers
        whole = all(isinstance(number, int) and 0 <= number < 2**31 for number in (chunk, file))
        if not whole or not 0 <= start <= stop < math.inf:
            raise DatasetError(
                f"{self._root}/meta/episodes: expected the video of {camera!r} as chunk, file, "
                f"from and to, found {pointers} in episode {episode}"
            )
        path = self._template.format(video_key=camera, chunk_index=chunk, file_index=file)
        number = FileNumber(chunk, file)
        return Clip(path_of_source(self._root, path), number, float(start), float(stop))


def has_content(root: Path, path: Path) -> bool:
    """Return whether a file of the dataset is there, after checking where its links lead."""
    path = path_of_source(root, path.relative_to(root).as_posix())
    return path.is_file() and path.stat().st_size > 0


def _files_v2(root: Path, camera: str) -> Iterator[tuple[int, Path]]:
    """Yield the episode and the path of each of a camera's files."""
    for folder in sorted((root / "videos").glob("*/")):
        if (folder / camera).is_dir():
            for path in sorted((folder / camera).iterdir()):
                match = _EPISODE_FILE.fullmatch(path.name)
                if match:
                    yield int(match[1]), path
