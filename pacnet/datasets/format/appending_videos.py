"""The videos of a dataset to append to: the numbers of the next files, and where they go."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.file_number import FileNumber
from pacnet.datasets.format.info import VIDEO, image_features
from pacnet.datasets.format.paths import VIDEO_PATH, check_video_path, path_for_file
from pacnet.datasets.format.tables import read_episode_rows


def next_video_files(root: Path, info: Mapping[str, Any]) -> dict[str, FileNumber]:
    """Return the number of the next video file of each camera.

    Raises:
        DatasetError: the videos are outside of the dataset, an episode has none, or there is a file
            of the next number.
    """
    cameras = image_features(info, VIDEO)
    if not cameras:
        return {}
    check_video_path(info.get("video_path") or VIDEO_PATH, cameras)
    columns = {
        camera: [f"videos/{camera}/{name}" for name in FileNumber._fields] for camera in cameras
    }
    last = dict.fromkeys(cameras, FileNumber(0, -1))
    for row in read_episode_rows(root, [name for names in columns.values() for name in names]):
        for camera, names in columns.items():
            pair: list[Any] = [row.get(name) for name in names]
            if not all(type(number) is int and 0 <= number < 2**31 for number in pair):
                raise DatasetError(
                    f"{root}/meta/episodes: expected a video of {camera!r} in episode "
                    f"{row['episode_index']}, found {pair}"
                )
            last[camera] = max(last[camera], FileNumber(*pair))
    found = {camera: number.next(info["chunks_size"]) for camera, number in last.items()}
    for camera, number in found.items():
        path = path_for_file(root, video_path(info, camera, number))
        if path.exists():
            raise DatasetError(f"{path} shows no episode: move it away")
    return found


def video_path(info: Mapping[str, Any], camera: str, number: FileNumber) -> str:
    """Return the path of a video file in the dataset's folder."""
    template = info.get("video_path") or VIDEO_PATH
    return template.format(video_key=camera, **number._asdict())
