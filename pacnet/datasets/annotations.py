"""A copy of a LeRobot dataset (format v3.0) with extra columns, such as what was recognised in it.

LeRobot takes every feature called `observation*` or `action*` for something to learn from; extra
columns of other names are left alone by its policies.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pacnet.core.durable import NEW, make_folder, sync_folder
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.features import RESERVED, Feature, checked_features, checked_frames
from pacnet.datasets.format.lerobot_files import PICTURES, read_info
from pacnet.datasets.recorder import Recorder

_INTEGERS = 2**24  # from here on float32, as which features are read, does not hold all of them


def write_annotated(
    source: str | Path,
    destination: str | Path,
    columns: Mapping[str, Sequence[str]],
    episodes: Iterable[Mapping[str, ArrayLike]],
) -> None:
    """Copy a dataset of numbers, with extra columns beside its features.

    Kept are the features and the names of their dimensions, each episode's task (that of its first
    frame), the frames per second and the robot's type. Integers are stored as int64, booleans as
    such and all floats as float32. Episodes are numbered from 0 and their time runs from 0. Columns
    of one dimension read back as scalars.

    Everything is checked before the copy is begun, and the copy is there as a whole or not at all.

    Args:
        source: The dataset's folder.
        destination: The copy's folder, which must not exist yet.
        columns: Name of each extra column -> names of its dimensions.
        episodes: One for each of the dataset's: column -> its values [T, K], T as many as the
            episode has frames; floats, integers or booleans, the same in all episodes.

    Raises:
        FileExistsError: There is something at `destination` already.
        DatasetError: The source cannot be read, has features that are no vectors of numbers (images
            and videos cannot be copied), or integers from 2**24 on.
        ValueError: No columns, one of a name that the source has or LeRobot cannot store, not one
            entry for each of the source's episodes, or values that are missing, unknown, of
            another shape, length or dtype, or not finite.
    """
    destination = Path(destination)
    if os.path.lexists(destination):
        raise FileExistsError(f"expected a folder to be made for the copy, {destination} exists")
    info = read_info(Path(source))
    copied = check_source(source, columns)
    first = next(iter(copied.values()))
    lengths = {episode.episode: len(episode.state) for episode in first}
    episodes = list(episodes)
    added = _extra_features(columns, episodes)
    annotations = _checked_annotations(added, episodes, lengths)
    features = {name: _feature(info, name, part) for name, part in copied.items()}
    make_folder(destination.parent)
    place = {"prefix": f".{destination.name}.", "suffix": NEW, "dir": destination.parent}
    with TemporaryDirectory(**place) as folder:  # also removes what an interrupt leaves
        copy = Path(folder) / destination.name
        fps, robot_type = _whole(info["fps"]), info.get("robot_type")
        with Recorder(copy, fps, features | added, robot_type) as recorder:
            for number, (episode, extra) in enumerate(zip(first, annotations, strict=True)):
                frames = {
                    name: part.episodes[number].state.numpy().astype(features[name].dtype)
                    for name, part in copied.items()
                }
                recorder.save_episode(episode.task, frames | extra)
        copy.rename(destination)
    sync_folder(destination.parent)


def check_source(
    source: str | Path, columns: Mapping[str, Sequence[str]]
) -> dict[str, Demonstrations]:
    """Whether a dataset can be copied with these extra columns, before there are any values.

    Returns:
        Every feature of it by name, each as the state of the demonstrations read.

    Raises:
        DatasetError: As `write_annotated`.
        ValueError: As `write_annotated`, about the columns and the frames per second.
    """
    info = read_info(Path(source))
    copied = _read_features(Path(source), info)
    _check_tasks(Path(source), next(iter(copied.values())))
    _check_columns(columns, {feature: part.names[feature] for feature, part in copied.items()})
    _whole(info["fps"])
    return copied


def _read_features(source: Path, info: dict[str, Any]) -> dict[str, Demonstrations]:
    """Every feature of the source by name, each as the state of the demonstrations read."""
    features = {name: told for name, told in info["features"].items() if name not in RESERVED}
    if not features:
        raise DatasetError(f"expected features to copy in {source}, found none")
    pictures = [
        name for name, told in features.items()
        if isinstance(told, dict) and told.get("dtype") in PICTURES
    ]  # fmt: skip
    if pictures:
        raise DatasetError(
            f"expected a dataset of numbers alone, images and videos cannot be copied: {source} "
            f"has {', '.join(pictures)}"
        )
    copied = {
        name: load_demonstrations(source, state=name, environment_state=None, action=name)
        for name in features
    }
    for name, part in copied.items():
        if "int" in features[name]["dtype"] and not all(_exact(e.state.numpy()) for e in part):
            raise DatasetError(
                f"expected integers in {name!r} that float32 holds, below {_INTEGERS}, {source} "
                "has others"
            )
    return copied


def _check_tasks(source: Path, episodes: Demonstrations) -> None:
    for episode in episodes:
        if not episode.task.strip():
            raise DatasetError(
                f"expected a task in words, {source} has {episode.task!r} in episode "
                f"{episode.episode}"
            )


def _check_columns(columns: Mapping[str, Sequence[str]], names: Mapping[str, object]) -> None:
    if not columns:
        raise ValueError("expected at least one column to add, got none")
    taken = sorted(set(columns) & set(names))
    if taken:
        raise ValueError(
            f"expected columns of names that the dataset has not, got {', '.join(taken)}"
        )


def _feature(info: Mapping[str, Any], name: str, part: Demonstrations) -> Feature:
    kinds = {"int": "int64", "uin": "int64", "boo": "bool"}
    dtype = kinds.get(info["features"][name]["dtype"][:3], "float32")
    return Feature(part.names[name], dtype)


def _extra_features(
    columns: Mapping[str, Sequence[str]], episodes: Sequence[Mapping[str, ArrayLike]]
) -> dict[str, Feature]:
    """The extra columns, each of the dtype that it has in the first episode that has it."""
    dtypes = {"b": "bool", "i": "int64", "u": "int64"}
    kinds: dict[str, str] = {}
    for episode in episodes[::-1]:
        kinds |= {name: np.asarray(values).dtype.kind for name, values in episode.items()}
    features = checked_features(columns)
    return {
        name: Feature(told.names, dtypes.get(kinds.get(name, "f"), "float32"))
        for name, told in features.items()
    }


def _checked_annotations(
    columns: Mapping[str, Feature],
    episodes: Sequence[Mapping[str, ArrayLike]],
    lengths: Mapping[int, int],
) -> list[dict[str, NDArray[np.generic]]]:
    """Each episode's columns [T, K] as they are stored, or a ValueError that names the episode."""
    if len(episodes) != len(lengths):
        raise ValueError(
            f"expected columns for each of {len(lengths)} episodes, got {len(episodes)}"
        )
    checked = []
    for (number, length), episode in zip(lengths.items(), episodes, strict=True):
        try:
            rows = checked_frames(columns, episode)
        except ValueError as error:
            raise ValueError(f"episode {number}: {error}") from None
        got = len(next(iter(rows.values())))
        if got != length:
            raise ValueError(f"episode {number}: expected {length} frames in columns, got {got}")
        checked.append(rows)
    return checked


def _exact(integers: NDArray[Any]) -> bool:
    """Whether float32 holds them all; they have been made float32 already."""
    return int(integers.max()) < _INTEGERS and int(integers.min()) > -_INTEGERS


def _whole(fps: float) -> int:
    if fps != int(fps):
        raise DatasetError(f"expected a whole number of frames per second, found {fps}")
    return int(fps)
