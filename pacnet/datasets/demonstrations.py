"""Demonstrations read from a LeRobot dataset (format v3.0) into tensors, without LeRobot."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
import torch
from torch import Tensor

from pacnet.datasets.format.encoded_images import Encoder, encode_images
from pacnet.datasets.format.errors import DatasetError
from pacnet.datasets.format.lerobot_files import (
    PICTURES,
    read_frames,
    read_info,
    read_tasks,
    told_names,
)
from pacnet.datasets.journal.journal import check_folded

STATE, ENVIRONMENT_STATE, ACTION = (
    "observation.state", "observation.environment_state", "action",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One episode of somebody doing a task.

    Attributes:
        episode: Number of the episode in its dataset.
        task: The task in words; where it changes within the episode, that of the first frame.
        state: What was perceived of the demonstrator, [T, S].
        environment_state: What was perceived of the surroundings, [T, E]; E is 0 without it.
        action: What the demonstrator did or aimed at, [T, A].
        encoded: What encoders made of its images, [T, F]; None without any.
    """

    episode: int
    task: str
    state: Tensor  # [T, S] float32
    environment_state: Tensor  # [T, E] float32
    action: Tensor  # [T, A] float32
    encoded: Tensor | None = None  # [T, F] float32

    @property
    def percepts(self) -> Tensor:
        """State, environment state and encoded images side by side, [T, S + E + F]."""
        parts = [self.state, self.environment_state]
        return torch.cat(parts if self.encoded is None else [*parts, self.encoded], dim=1)


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """The episodes of a dataset, in the order in which they were recorded.

    Attributes:
        fps: Frames per second [1/s].
        names: Feature name -> names of its dimensions, in the order of the percepts.
        episodes: The demonstrations.
        source: Name of the dataset that they are from.
        action: The feature that is their action; all others are perceived.
    """

    fps: float
    names: Mapping[str, tuple[str, ...]]
    episodes: tuple[Demonstration, ...]
    source: str = "demonstrations"
    action: str = ACTION

    @property
    def percept_features(self) -> dict[str, tuple[str, ...]]:
        """Feature -> names of its dimensions, of what a percept is made of, in its order."""
        return {name: parts for name, parts in self.names.items() if name != self.action}

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of an action's dimensions."""
        return self.names[self.action]

    def __iter__(self) -> Iterator[Demonstration]:
        """The demonstrations, one after the other."""
        return iter(self.episodes)

    def __len__(self) -> int:
        """Number of demonstrations."""
        return len(self.episodes)


def dimension_names(features: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Names of all dimensions, after their features too where two have one name.

    Args:
        features: Feature name -> names of its dimensions.
    """
    pairs = [(feature, name) for feature, names in features.items() for name in names]
    names = tuple(name for _, name in pairs)
    if len(set(names)) < len(names):
        return tuple(f"{feature}.{name}" for feature, name in pairs)
    return names


def load_demonstrations(
    root: str | Path,
    *,
    state: str = STATE,
    environment_state: str | None = ENVIRONMENT_STATE,
    action: str = ACTION,
    encoders: Mapping[str, Encoder] | None = None,
) -> Demonstrations:
    """Read every episode of a LeRobot dataset.

    Images are left alone, or seen through encoders. These need LeRobot, which decodes the images.

    Example:
        ```python
        demonstrations = load_demonstrations("drinking", environment_state=None)
        demonstrations = load_demonstrations("drinking", encoders={"observation.images.top": net})
        ```

    Args:
        root: The dataset's folder, the one that holds `meta/` and `data/`.
        state: Feature that becomes `Demonstration.state`.
        environment_state: Feature that becomes `Demonstration.environment_state`, or None; where
            it is not told otherwise, a dataset may lack it.
        action: Feature that becomes `Demonstration.action`.
        encoders: Image or video feature -> what makes a vector [F] of each of its images, a tensor
            of shape [channels, height, width] from 0 to 1. They become `Demonstration.encoded`.

    Returns:
        The demonstrations, float32 tensors on the CPU.

    Raises:
        DatasetError: The folder or one of its files is missing or damaged, the format is another
            than v3.0, a recording into it goes on or was killed, a feature is missing or not a
            vector of numbers, the counts in `meta/info.json` do not match the frames found, the
            episodes' numbers do not ascend, or a value is not finite.
        ValueError: An encoder for a feature that is no image or video, or one that gives something
            else than finite vectors of one length.
    """
    root = Path(root)
    check_folded(root)
    info = read_info(root)
    if environment_state == ENVIRONMENT_STATE and environment_state not in info["features"]:
        environment_state = None
    features = [name for name in (state, environment_state, action) if name is not None]
    dimensions = {feature: _dimension(info, feature) for feature in features}
    frames = read_frames(root, dimensions, info["total_frames"])
    names = {feature: _dimension_names(info, feature) for feature in features}
    starts = _episode_starts(info, frames)
    for feature in features:
        _check_finite(frames, feature, names[feature])

    tasks = read_tasks(root, frames["task_index"][starts])
    lengths = np.diff(starts, append=len(frames["index"])).tolist()
    columns = {feature: torch.from_numpy(frames[feature]).split(lengths) for feature in features}
    nothing = [torch.empty(length, 0) for length in lengths]
    episodes = tuple(
        Demonstration(int(number), task, *tensors)
        for number, task, *tensors in zip(
            frames["episode_index"][starts],
            tasks,
            columns[state],
            nothing if environment_state is None else columns[environment_state],
            columns[action],
            strict=True,
        )
    )
    if encoders:
        episodes = _with_encoded(root, info, encoders, names, episodes)
    return Demonstrations(info["fps"], names, episodes, root.resolve().name, action)


def _with_encoded(
    root: Path,
    info: dict[str, Any],
    encoders: Mapping[str, Encoder],
    names: dict[str, tuple[str, ...]],
    episodes: tuple[Demonstration, ...],
) -> tuple[Demonstration, ...]:
    """The episodes with encoded images; their dimensions are added to the names."""
    encoded = encode_images(root, info, encoders)
    names |= {
        feature: tuple(f"{feature}.{place}" for place in range(rows.shape[1]))
        for feature, rows in encoded.items()
    }
    lengths = [len(episode.state) for episode in episodes]
    parts = torch.cat(list(encoded.values()), dim=1).split(lengths)
    return tuple(
        replace(episode, encoded=part) for episode, part in zip(episodes, parts, strict=True)
    )


def _dimension(info: dict[str, Any], feature: str) -> int:
    """The number of a feature's dimensions, which the data files have still to confirm."""
    if feature not in info["features"]:
        there = ", ".join(sorted(info["features"]))
        raise DatasetError(f"expected the feature {feature!r}, the dataset has {there}")
    description = info["features"][feature]
    wanted = f"expected {feature!r} to be a vector of numbers of shape [D > 0]"
    if not isinstance(description, dict):
        raise DatasetError(f"{wanted}, found the description {description!r}")
    dtype, shape = description.get("dtype"), description.get("shape")
    if dtype in PICTURES:
        raise DatasetError(
            f"{wanted}, found {dtype}s of shape {shape}: percepts are made of them by an encoder, "
            f"load_demonstrations(..., encoders={{{feature!r}: encoder}})"
        )
    if not re.match("float|u?int|bool", str(dtype)) or not _is_vector_shape(shape):
        raise DatasetError(f"{wanted}, found dtype {dtype}, shape {shape}")
    return shape[0]


def _dimension_names(info: dict[str, Any], feature: str) -> tuple[str, ...]:
    """The names of a feature's dimensions, or their numbers where the dataset has no names."""
    description = info["features"][feature]
    return tuple(told_names(description) or map(str, range(description["shape"][0])))


def _is_vector_shape(shape: object) -> TypeGuard[list[int]]:
    return isinstance(shape, list) and [type(size) for size in shape] == [int] and shape[0] > 0


def _episode_starts(info: dict[str, Any], frames: Mapping[str, np.ndarray]) -> np.ndarray:
    """The row at which each episode starts, after comparing the frames with info.json."""
    found = len(frames["index"])
    if not np.array_equal(frames["index"], np.arange(found)):
        raise DatasetError(f"expected the frames' index to run from 0 to {found - 1} without gaps")
    starts = np.flatnonzero(np.diff(frames["episode_index"], prepend=-1))
    expected, found = info["total_episodes"], len(np.unique(frames["episode_index"]))
    if found != expected or len(starts) != expected:
        raise DatasetError(
            f"meta/info.json counts {expected} episodes, the data files hold {found} "
            f"in {len(starts)} runs of frames"
        )
    numbers = frames["episode_index"][starts]
    for before, number in pairwise(numbers.tolist()):
        if not before < number:
            raise DatasetError(f"expected ascending episodes, found {number} after {before}")
    return starts


def _check_finite(frames: Mapping[str, np.ndarray], feature: str, names: tuple[str, ...]) -> None:
    bad = np.argwhere(~np.isfinite(frames[feature]))
    if len(bad):
        row, dimension = bad[0]
        raise DatasetError(
            f"expected finite numbers, found {len(bad)} others in {feature!r}, the first at index "
            f"{row} (episode {frames['episode_index'][row]}), dimension {names[dimension]!r}"
        )
