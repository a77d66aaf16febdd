"""The episodes of a dataset: their features as tensors, checked, with their tasks and time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format import DatasetError, DatasetWarning, MissingFeature
from pacnet.datasets.format.data_files import (
    EPISODE,
    FRAME,
    INDEX,
    ROW,
    TASK,
    TIME,
    Columns,
    read_data_files,
)
from pacnet.datasets.format.episode_list import listed_episodes
from pacnet.datasets.format.info import listed_names
from pacnet.datasets.format.selection import Selection, selected_episodes
from pacnet.datasets.format.tables import OLD_TASKS, TASKS, read_tasks
from pacnet.datasets.format.vectors import check_vectors, missing_features


class Episodes(NamedTuple):
    """E episodes of a dataset, N frames, in the order of their indices and of time."""

    indices: list[int]  # [E]
    tasks: list[str]  # [E], of the first frame of each
    lengths: list[int]  # [E] in frames
    names: dict[str, tuple[str, ...]]  # feature -> names of its dimensions
    values: dict[str, NDArray[np.float32]]  # feature -> [N, D]
    timestamps: NDArray[np.float64] | None  # [N] in s; None where there are none
    frame_indices: NDArray[np.int64] | None  # [N]; None where there are none
    rows: NDArray[np.int64]  # [N], which rows of all data files they are, one after the other
    files: dict[Path, int]  # these files, and their numbers of rows

    def split(self, rows: NDArray[Any]) -> list[NDArray[Any]]:
        """Return the rows `[N, ...]` of each episode."""
        bounds = [0, *accumulate(self.lengths)]
        return [rows[start:end] for start, end in pairwise(bounds)]

    def place(self, row: int) -> tuple[int, int]:
        """Return the index of the episode of one of the N frames, and its number there."""
        ends = np.cumsum(self.lengths)
        number = int(np.searchsorted(ends, row, side="right"))
        return self.indices[number], row - int(ends[number]) + self.lengths[number]


def read_episodes(
    root: Path, info: dict[str, Any], features: Sequence[str], selection: Selection | None = None
) -> Episodes:
    """Read these features of a dataset that `info` describes, as vectors of numbers.

    Where the description contradicts the data, the data count, and a `DatasetWarning` says so.

    Raises:
        MissingFeature: a feature that is not there.
        DatasetError: a file is damaged or missing, or frames are there twice or out of order.
    """
    selection = selection or Selection()
    check_vectors(root, info, features)
    try:
        files = read_data_files(root, features)
    except MissingFeature as error:
        raise missing_features(root, info, error.features) from None
    columns = _in_order(files.columns)
    starts = np.flatnonzero(np.diff(columns[EPISODE], prepend=-1))
    lengths = np.diff(starts, append=len(columns[EPISODE]))
    there = dict(zip(columns[EPISODE][starts].tolist(), lengths.tolist(), strict=True))
    indices = selected_episodes(root, info, there, files.damaged, selection)
    chosen = np.isin([*there], indices)
    if not chosen.all():
        kept = np.repeat(chosen, lengths)
        columns = {name: rows[kept] for name, rows in columns.items()}
    tasks = columns[TASK][np.cumsum([0, *lengths[chosen][:-1]])] if TASK in columns else None
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        values = {name: columns[name].astype(np.float32) for name in features}
    return Episodes(
        indices,
        _tasks(root, info, indices, tasks, selection),
        lengths[chosen].tolist(),
        {name: _names(info, name, rows.shape[1]) for name, rows in values.items()},
        values,
        columns.get(TIME),
        columns.get(FRAME),
        columns[ROW],
        files.lengths,
    )


def _in_order(columns: Columns) -> Columns:
    """Return the frames in the order of episodes and time, each of them once; and `ROW`."""
    episodes = columns[EPISODE]
    rows = np.arange(len(episodes))
    name = next((name for name in (INDEX, FRAME) if name in columns), None)
    place = columns[name] if name else rows
    columns = columns | {ROW: rows}
    steps, later = np.diff(episodes), np.diff(place) > 0
    if (steps >= 0).all() and (later | (steps > 0)).all():
        return columns  # as they are stored, without a copy
    order = np.lexsort((place, episodes))
    _check_once(episodes[order], place[order], name)
    if name == INDEX:
        _check_in_one_piece(episodes, place)
    return {name: values[order] for name, values in columns.items()}


def _check_once(episodes: NDArray[np.int64], place: NDArray[np.int64], name: str | None) -> None:
    twice = np.flatnonzero((np.diff(episodes) == 0) & (np.diff(place) == 0))
    if len(twice):
        raise DatasetError(
            f"expected each frame once, found {name} {place[twice[0]]} of episode "
            f"{episodes[twice[0]]} twice"
        )


def _check_in_one_piece(episodes: NDArray[np.int64], index: NDArray[np.int64]) -> None:
    """Refuse episodes that others interrupt; an index may also begin anew with each of them."""
    if len(np.unique(index)) < len(index):
        return
    n_runs = 1 + np.count_nonzero(np.diff(episodes[np.argsort(index)]))
    n_episodes = len(np.unique(episodes))
    if n_runs != n_episodes:
        raise DatasetError(
            f"expected the frames of each episode in one run, found {n_episodes} episodes in "
            f"{n_runs} runs of frames"
        )


def _names(info: Mapping[str, Any], feature: str, dimension: int) -> tuple[str, ...]:
    """Return the names of a feature's dimensions, made different where they are not."""
    entry = info["features"].get(feature, {})
    shape = entry.get("shape")
    if shape not in ([dimension], None):
        warnings.warn(
            f"meta/info.json gives {feature!r} the shape {shape}, its vectors have {dimension} "
            "dimensions: these are read",
            DatasetWarning,
            stacklevel=2,
        )
    names = listed_names(entry)
    if names is None or len(names) != dimension:
        return tuple(map(str, range(dimension)))
    if len(set(names)) < len(names):
        return tuple(f"{name}.{number}" for number, name in enumerate(names))
    return tuple(names)


def _tasks(
    root: Path,
    info: Mapping[str, Any],
    episodes: Sequence[int],
    numbers: NDArray[np.int64] | None,  # [E], of the first frame of each
    selection: Selection,
) -> list[str]:
    """Return each episode's task: of its first frame, else as the episodes' list has it."""
    try:
        if numbers is None:
            raise DatasetError(f"the data files have no {TASK!r}")
        tasks, wanted = read_tasks(root), numbers.tolist()
        unknown = sorted(set(wanted) - set(tasks))
        if unknown:
            path = root / (TASKS if (root / TASKS).exists() else OLD_TASKS)
            raise DatasetError(f"{path}: expected the tasks {unknown}, found {sorted(tasks)}")
    except DatasetError as error:
        if numbers is not None and not selection.skip_damaged:
            hint = "read the episodes without it with --skip-damaged (skip_damaged=True)"
            raise DatasetError(f"{error}: {hint}") from error
        listed = listed_episodes(root, info)
        found = [listed[one].task if one in listed else None for one in episodes]
        source = "the episodes' list" if any(found) else "nowhere, they have no names"
        warnings.warn(f"{error}: tasks are taken from {source}", DatasetWarning, stacklevel=2)
        return [task or "" for task in found]
    return [tasks[number] for number in wanted]
