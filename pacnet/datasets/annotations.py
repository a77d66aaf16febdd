"""A copy of a LeRobot dataset (format v3.0) with extra columns, such as recognition results.

LeRobot's policies learn from every feature called `observation*` or `action*`, and leave columns of
other names alone.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pacnet.core.durable import NEW, make_folder, sync_folder
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.features import (
    RESERVED,
    Arrays,
    Feature,
    checked_episode,
    checked_features,
)
from pacnet.datasets.format.info import image_features, read_info
from pacnet.datasets.recorder import Recorder

# What imports pyarrow, 0.2 s, is imported where it is used.
if TYPE_CHECKING:
    from pacnet.datasets.format.episodes import Episodes

_FLOAT32_INTEGERS = 2**24  # features are read as float32, which holds all integers below this
_DTYPES = {"b": "bool", "i": "int64", "u": "int64"}  # kind, or a name's first letter -> stored


def write_annotated(
    source: str | Path,
    destination: str | Path,
    columns: Mapping[str, Sequence[str]],
    episodes: Iterable[Mapping[str, ArrayLike]],
) -> None:
    """Copy a dataset of numbers, with extra columns beside its features.

    The copy keeps the features and the names of their dimensions, each episode's task (that of its
    first frame), the frames per second and the robot's type. Integers are stored as int64, booleans
    as such and all floats as float32. Episodes are numbered from 0 and their time runs from 0.
    Columns of one dimension read back as scalars.

    Everything is checked before the copy is begun, and an interrupted copy leaves nothing.

    Args:
        source: the dataset's folder.
        destination: the copy's folder, which must not exist yet.
        columns: name of each extra column -> names of its dimensions.
        episodes: for each episode of the dataset: column -> its values `[T, K]`, one row per
            frame; floats, integers or booleans, the same in all episodes.

    Raises:
        FileExistsError: `destination` exists already.
        DatasetError: the source cannot be read, or has features other than vectors of numbers
            (images and videos cannot be copied), or integers from 2**24 on.
        ValueError: no columns; a column's name is a feature of the source or cannot be stored by
            LeRobot; not one entry for each episode of the source; or values that are missing,
            unknown, of another shape, length or dtype, or not finite.
    """
    source, destination = Path(source), Path(destination)
    if os.path.lexists(destination):
        raise FileExistsError(f"expected a folder to be made for the copy, {destination} exists")
    read = check_annotatable(source, columns)
    episodes = list(episodes)
    added = _column_features(columns, episodes)
    annotations = _checked_annotations(added, episodes, read)
    info = read_info(source)
    features = {
        name: Feature(names, _DTYPES.get(info["features"][name]["dtype"][0], "float32"))
        for name, names in read.names.items()
    }
    make_folder(destination.parent)
    location = {"prefix": f".{destination.name}.", "suffix": NEW, "dir": destination.parent}
    with TemporaryDirectory(**location) as folder:  # also removes what an interrupt leaves
        copy = Path(folder) / destination.name
        with Recorder(copy, int(info["fps"]), features | added, info.get("robot_type")) as recorder:
            for index, (task, annotation) in enumerate(zip(read.tasks, annotations, strict=True)):
                frames = {
                    name: read.split(values)[index].astype(features[name].dtype)
                    for name, values in read.values.items()
                }
                recorder.save_episode(task, frames | annotation)
        copy.rename(destination)
    sync_folder(destination.parent)


def check_annotatable(source: str | Path, columns: Mapping[str, Sequence[str]]) -> "Episodes":
    """Read a dataset after checking that it can be copied with these extra columns.

    Raises:
        DatasetError: as `write_annotated`.
        ValueError: as `write_annotated`, about the columns.
    """
    from pacnet.datasets.format.episodes import read_episodes
    from pacnet.datasets.journal.journal import check_folded

    source = Path(source)
    check_folded(source)
    info = read_info(source)
    features = [name for name in info["features"] if name not in RESERVED]
    if not features:
        raise DatasetError(f"expected features to copy in {source}, found none")
    images = image_features(info)
    if images:
        raise DatasetError(
            f"expected a dataset of numbers alone, images and videos cannot be copied: {source} "
            f"has {', '.join(images)}"
        )
    if not columns:
        raise ValueError("expected at least one column to add, got none")
    taken = sorted(set(columns) & set(features))
    if taken:
        raise ValueError(f"expected columns that the dataset does not have, got {', '.join(taken)}")
    if info["fps"] != int(info["fps"]):
        raise DatasetError(f"expected a whole number of frames per second, found {info['fps']}")
    read = read_episodes(source, info, features)
    _check_values(source, info, read)
    return read


def _check_values(source: Path, info: Mapping[str, Any], read: "Episodes") -> None:
    """Refuse integers that float32 rounds, and tasks that `Recorder` does not store."""
    for name, values in read.values.items():
        integers = "int" in info["features"][name]["dtype"]
        if integers and np.abs(values).max() >= _FLOAT32_INTEGERS:
            raise DatasetError(
                f"expected integers in {name!r} that float32 holds, below {_FLOAT32_INTEGERS}, "
                f"{source} has others"
            )
    for index, task in zip(read.indices, read.tasks, strict=True):
        if not task.strip():
            raise DatasetError(
                f"expected a task in words, {source} has {task!r} in episode {index}"
            )


def _column_features(
    columns: Mapping[str, Sequence[str]], episodes: Sequence[Mapping[str, ArrayLike]]
) -> dict[str, Feature]:
    """Return the extra columns, each of the dtype that it has in the first episode that has it."""
    kinds: dict[str, str] = {}
    for episode in episodes[::-1]:
        kinds |= {name: np.asarray(values).dtype.kind for name, values in episode.items()}
    return {
        name: Feature(feature.names, _DTYPES.get(kinds.get(name, "f"), "float32"))
        for name, feature in checked_features(columns).items()
    }


def _checked_annotations(
    columns: Mapping[str, Feature], episodes: Sequence[Mapping[str, ArrayLike]], read: "Episodes"
) -> list[Arrays]:
    """Return each episode's columns `[T, K]` as they are stored."""
    expected = len(read.indices)
    if len(episodes) != expected:
        raise ValueError(f"expected columns for each of {expected} episodes, got {len(episodes)}")
    checked = []
    for index, length, episode in zip(read.indices, read.lengths, episodes, strict=True):
        try:
            arrays = checked_episode(columns, episode)
        except ValueError as error:
            raise ValueError(f"episode {index}: {error}") from None
        found = len(next(iter(arrays.values())))
        if found != length:
            raise ValueError(f"episode {index}: expected {length} frames in columns, got {found}")
        checked.append(arrays)
    return checked
