"""A copy of a LeRobot dataset (format v3.0) with extra columns, such as what was recognised in it.

LeRobot takes every feature called `observation*` or `action*` for something to learn from; extra
columns of other names are left alone by its policies.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pacnet.demonstration_writer import RESERVED, DemonstrationWriter, checked_frames
from pacnet.demonstrations import Demonstrations, load_demonstrations
from pacnet.lerobot_files import DatasetError, read_info

_INTEGERS = 2**24  # from here on float32 does not hold all of them
_PICTURES = ("image", "video")


def write_annotated(
    source: str | Path,
    destination: str | Path,
    columns: Mapping[str, Sequence[str]],
    episodes: Iterable[Mapping[str, ArrayLike]],
) -> None:
    """Copy a dataset of numbers, with extra columns beside its features; needs LeRobot.

    Kept are the features and the names of their dimensions, each episode's task (that of its first
    frame), the frames per second and the robot's type. All columns of the copy are float32: float64
    is rounded, and integers from 2**24 on, not all of which float32 holds, are refused. Episodes
    are numbered from 0 and their time runs from 0. Columns of one dimension read back as scalars.

    Everything is checked before the copy is begun.

    Args:
        source: The dataset's folder.
        destination: The copy's folder, which must not exist yet.
        columns: Name of each extra column -> names of its dimensions.
        episodes: One for each of the dataset's: column -> its values [T, K], T as many as the
            episode has frames; floats, integers or booleans (stored as 0 and 1).

    Raises:
        FileExistsError: There is something at `destination` already.
        DatasetError: The source cannot be read, or has features that are no vectors of numbers:
            images and videos cannot be copied.
        ValueError: No columns, one of a name that the source has or LeRobot cannot store, not one
            entry for each of the source's episodes, or values that are missing, unknown, of
            another shape or length, not finite, or integers that float32 cannot hold.
    """
    destination = Path(destination)
    if destination.exists():
        raise FileExistsError(f"expected a folder to be made for the copy, {destination} exists")
    info = read_info(Path(source))
    copied = check_source(source, columns)
    first = next(iter(copied.values()))
    names = {feature: part.names[feature] for feature, part in copied.items()}
    robot = info.get("robot_type")
    writer = DemonstrationWriter(destination, _whole(info["fps"]), {**names, **columns}, robot)
    lengths = {episode.episode: len(episode.state) for episode in first}
    annotations = _checked_annotations(columns, list(episodes), lengths)
    with writer:
        for number, (episode, added) in enumerate(zip(first, annotations, strict=True)):
            frames = {name: part.episodes[number].state.numpy() for name, part in copied.items()}
            writer.save_episode(episode.task, {**frames, **added})


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
        if isinstance(told, dict) and told.get("dtype") in _PICTURES
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
            raise DatasetError(f"{_wanted(name)}, {source} has others")
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


def _checked_annotations(
    columns: Mapping[str, Sequence[str]],
    episodes: Sequence[Mapping[str, ArrayLike]],
    lengths: Mapping[int, int],
) -> list[dict[str, NDArray[np.float32]]]:
    """Each episode's columns as float32 [T, K], or a ValueError that names the episode."""
    if len(episodes) != len(lengths):
        raise ValueError(
            f"expected columns for each of {len(lengths)} episodes, got {len(episodes)}"
        )
    checked = []
    for (number, length), episode in zip(lengths.items(), episodes, strict=True):
        try:
            floats = {name: _as_floats(name, values) for name, values in episode.items()}
            rows = checked_frames(columns, floats)
        except ValueError as error:
            raise ValueError(f"episode {number}: {error}") from None
        got = len(next(iter(rows.values())))
        if got != length:
            raise ValueError(f"episode {number}: expected {length} frames in columns, got {got}")
        checked.append(rows)
    return checked


def _as_floats(name: str, values: ArrayLike) -> NDArray[Any]:
    """Integers and booleans as float32, everything else as it is."""
    array = np.asarray(values)
    if array.dtype.kind not in "biu":
        return array
    if not _exact(array):
        raise ValueError(f"{_wanted(name)}, got others")
    return array.astype(np.float32)


def _exact(integers: NDArray[Any]) -> bool:
    """Whether float32 holds them all; they may have been made float32 already."""
    return not integers.size or (
        int(integers.max()) < _INTEGERS and int(integers.min()) > -_INTEGERS
    )


def _wanted(name: str) -> str:
    return f"expected integers in {name!r} that float32 holds, below {_INTEGERS}"


def _whole(fps: float) -> int:
    if fps != int(fps):
        raise DatasetError(f"expected a whole number of frames per second, found {fps}")
    return int(fps)
