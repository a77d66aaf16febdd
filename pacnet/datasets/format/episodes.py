"""Every episode of a dataset: its features as tensors, checked, and its task."""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.info import image_features, listed_names
from pacnet.datasets.format.parquet import as_indices, count_rows, read_columns
from pacnet.datasets.format.tables import TASKS, read_tasks

_INDICES = ("index", "episode_index", "task_index")


class Episodes(NamedTuple):
    """The episodes of a dataset, in the order in which they were recorded."""

    indices: list[int]
    tasks: list[str]  # of the first frame of each
    lengths: list[int]  # [frames]
    names: dict[str, tuple[str, ...]]  # feature -> names of its dimensions
    values: dict[str, tuple[Tensor, ...]]  # feature -> [T, D] float32 of each episode


def read_episodes(root: Path, info: dict[str, Any], features: Sequence[str]) -> Episodes:
    """Read these features of a dataset that `info` describes, as finite vectors of numbers."""
    dimensions = {feature: _dimension(info, feature) for feature in features}
    frames = _read_frames(root, dimensions, info["total_frames"])
    names = {  # the numbers of dimensions are verified by now
        feature: tuple(listed_names(info["features"][feature]) or map(str, range(dimension)))
        for feature, dimension in dimensions.items()
    }
    starts = _episode_starts(info, frames)
    for feature in features:
        _check_finite(frames, feature, names[feature])
    tasks, task_indices = read_tasks(root), frames["task_index"][starts].tolist()
    unknown = sorted(set(task_indices) - set(tasks))
    if unknown:
        raise DatasetError(f"{root / TASKS}: expected the tasks {unknown}, found {sorted(tasks)}")
    lengths = np.diff(starts, append=len(frames["index"])).tolist()
    return Episodes(
        frames["episode_index"][starts].tolist(),
        [tasks[index] for index in task_indices],
        lengths,
        names,
        {feature: torch.from_numpy(frames[feature]).split(lengths) for feature in features},
    )


def _dimension(info: dict[str, Any], feature: str) -> int:
    """Return the number of a feature's dimensions as `info` has it."""
    if feature not in info["features"]:
        found = ", ".join(sorted(info["features"]))
        raise DatasetError(f"expected the feature {feature!r}, the dataset has {found}")
    entry = info["features"][feature]
    expected = f"expected {feature!r} to be a vector of numbers of shape [D > 0]"
    if not isinstance(entry, dict):
        raise DatasetError(f"{expected}, found the description {entry!r}")
    dtype, shape = entry.get("dtype"), entry.get("shape")
    if feature in image_features(info):
        raise DatasetError(
            f"{expected}, found {dtype}s of shape {shape}: percepts are made of them by an "
            f"encoder, load_demonstrations(..., encoders={{{feature!r}: encoder}})"
        )
    is_vector = isinstance(shape, list) and [*map(type, shape)] == [int] and shape[0] > 0
    if not is_vector or not re.match("float|u?int|bool", str(dtype)):
        raise DatasetError(f"{expected}, found dtype {dtype}, shape {shape}")
    return entry["shape"][0]


def _read_frames(
    root: Path, dimensions: Mapping[str, int], total_frames: float
) -> dict[str, NDArray[Any]]:
    """Read the indices `[N]` and the features `[N, D]` of all data files, ordered by `index`."""
    paths = sorted((root / "data").glob("*/*.parquet"))
    if not paths:
        raise DatasetError(f"{root} has no data: expected data/chunk-*/file-*.parquet, found none")
    found = sum(map(count_rows, paths))
    if found != total_frames:  # compared before any frame is read
        raise DatasetError(
            f"meta/info.json counts {total_frames} frames, the data files hold {found}"
        )
    files = []
    for path in paths:
        columns = read_columns(path, {**dict.fromkeys(_INDICES, 1), **dimensions})
        indices = {name: as_indices(path, name, columns[name][:, 0]) for name in _INDICES}
        files.append(columns | indices)
    frames = {name: np.concatenate([file[name] for file in files]) for name in files[0]}
    order = np.argsort(frames["index"], kind="stable")
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        return {
            name: rows[order].astype(np.float32) if name in dimensions else rows[order]
            for name, rows in frames.items()
        }


def _episode_starts(info: dict[str, Any], frames: Mapping[str, NDArray[Any]]) -> NDArray[np.intp]:
    """Return the row at which each episode starts, after comparing the frames with `info`."""
    last = len(frames["index"]) - 1
    if not np.array_equal(frames["index"], np.arange(last + 1)):
        raise DatasetError(f"expected the frames' index to run from 0 to {last} without gaps")
    starts = np.flatnonzero(np.diff(frames["episode_index"], prepend=-1))
    expected, found = info["total_episodes"], len(np.unique(frames["episode_index"]))
    if found != expected or len(starts) != expected:
        raise DatasetError(
            f"meta/info.json counts {expected} episodes, the data files hold {found} "
            f"in {len(starts)} runs of frames"
        )
    for before, index in pairwise(frames["episode_index"][starts].tolist()):
        if not before < index:
            raise DatasetError(f"expected ascending episodes, found {index} after {before}")
    return starts


def _check_finite(frames: Mapping[str, NDArray[Any]], feature: str, names: tuple[str, ...]) -> None:
    bad = np.argwhere(~np.isfinite(frames[feature]))
    if len(bad):
        row, dimension = bad[0]
        raise DatasetError(
            f"expected finite numbers, found {len(bad)} others in {feature!r}, the first at index "
            f"{row} (episode {frames['episode_index'][row]}), dimension {names[dimension]!r}"
        )
