"""Demonstrations read from a LeRobot dataset (v3.0, v2.1 or v2.0) into tensors, without LeRobot."""

from __future__ import annotations

import reprlib
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.datasets.feature_choice import (
    ENVIRONMENT_STATE,
    STATE,
    Choice,
    choose_features,
    explain_missing,
)
from pacnet.datasets.format import DatasetError, DatasetWarning, MissingFeature
from pacnet.datasets.format.angles import find_wraps
from pacnet.datasets.format.info import INFO, is_rate, read_info
from pacnet.datasets.format.numbers import numbers_text
from pacnet.datasets.format.times import find_gaps
from pacnet.datasets.locate import find_dataset, source_name
from pacnet.datasets.records import ACTION, Demonstration, Demonstrations, dimension_names

# What imports pyarrow, 0.2 s, is imported where it is used.
if TYPE_CHECKING:
    from pacnet.datasets.format.episodes import Episodes
    from pacnet.datasets.pictures.camera_choice import CameraChoice
    from pacnet.datasets.pictures.footage import Pictures

__all__ = [
    "ACTION", "ENVIRONMENT_STATE", "STATE", "Demonstration", "Demonstrations", "dimension_names",
    "load_demonstrations",
]  # fmt: skip


def load_demonstrations(
    root: str | Path,
    *,
    state: Choice = STATE,
    environment_state: Choice = ENVIRONMENT_STATE,
    action: Choice = ACTION,
    cameras: CameraChoice | None = None,
    episodes: Iterable[int] | None = None,
    exclude: Iterable[int] = (),
    only_where: str | None = None,
    skip_damaged: bool = False,
) -> Demonstrations:
    """Read the episodes of a LeRobot dataset, format v3.0, v2.1 or v2.0.

    Where the files contradict one another the frames count, and a `DatasetWarning` says so. The
    same tells of gaps in time, across which `Imitator` does not learn, and of angles that wrap.

    Pictures are read only of the cameras asked for; PyAV and Pillow decode them, and they are kept
    in a cache.

    Example:
        ```python
        demonstrations = load_demonstrations("drinking", environment_state=None)
        demonstrations = load_demonstrations("drinking", state=["arm", "hand"], exclude=[3])
        demonstrations = load_demonstrations("drinking", cameras="all")  # or ["top", "wrist"]
        ```

    Args:
        root: the dataset's folder, the one that holds `meta/` and `data/`; or `user/name` of one
            in LeRobot's cache.
        state: feature that becomes `Demonstration.state`, or several side by side in this order;
            None for none. The default one may be missing where there is an environment state.
        environment_state: the same for `Demonstration.environment_state`; a dataset may lack the
            default one.
        action: the same for `Demonstration.action`.
        cameras: features of images or videos that become `Demonstration.pictures`, or the last
            parts of their names; "all" for all that can be read, and a `DatasetWarning` about
            others; None for none.
        episodes: indices of the episodes to read; None for all.
        exclude: indices of episodes to leave out.
        only_where: boolean feature; only frames where it is true are read, and each run of them
            is a demonstration of its own.
        skip_damaged: whether files that cannot be read, and incomplete episodes, are left out with
            a `DatasetWarning` rather than refused.

    Returns:
        The demonstrations, float32 tensors on the CPU.

    Raises:
        MissingFeature: a feature is missing; the message names the vectors that there are.
        DatasetError: the folder or one of its files is missing or damaged, the format is another
            one, a recording into it is running or was killed, a feature is not a vector of
            numbers, an episode asked for is not there, a value is not finite, or a camera or its
            pictures cannot be read.
        ValueError: a feature is given twice, or none for percepts.
    """
    from pacnet.datasets.format.episodes import read_episodes
    from pacnet.datasets.format.selection import Selection
    from pacnet.datasets.format.vectors import vector_columns
    from pacnet.datasets.journal.journal import check_folded

    name, root = root, find_dataset(root)
    check_folded(root)
    info = read_info(root)
    choice = (state, environment_state, action)
    selection = Selection.of(episodes, exclude, skip_damaged)
    where = () if only_where is None else (only_where,)
    features = choose_features([*info["features"]], *choice)
    if not features.percepts and cameras is None:
        raise ValueError("expected a state, an environment state or cameras, got none")
    try:
        read = read_episodes(root, info, features.and_also(*where), selection)
    except MissingFeature as error:
        there = [name for name in vector_columns(root, info) if name in info["features"]]
        others = choose_features(there, *choice)  # without defaults that are only declared
        if others == features:
            raise explain_missing(error, features, only_where) from None
        features = others
        read = read_episodes(root, info, features.and_also(*where), selection)
    vectors = features.and_also()
    fps = _rate(root / INFO, info, read)
    taken = _taken(read, only_where)
    _check_finite(read, vectors, taken)
    _tell_wraps(read, vectors, fps)
    names = {feature: read.names[feature] for feature in (*features.percepts, *features.action)}
    kinds = [_side_by_side(read, kind) for kind in features]
    pictures, damaged = _pictures(root, info, cameras, read, fps, skip_damaged)
    shown = tuple(
        part
        for number, whole in enumerate(_episodes(read, kinds, pictures, _gaps(fps, read)))
        for part in _runs(whole, taken[number])
        if whole.episode not in damaged
    )
    if not shown:
        raise DatasetError(f"expected frames where {only_where!r} is true, the dataset has none")
    chosen = features.action[0] if len(features.action) == 1 else features.action
    return Demonstrations(fps, names, shown, source_name(name, root), chosen, features.state)


def _side_by_side(read: Episodes, features: Sequence[str]) -> tuple[Tensor, ...]:
    """Return the values of several features `[T, D]` of each episode."""
    rows = [read.values[name] for name in features]
    if not rows:
        rows = [np.empty((len(read.rows), 0), np.float32)]
    whole = rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)
    return torch.from_numpy(whole).split(read.lengths)


def _episodes(
    read: Episodes,
    kinds: Sequence[Sequence[Tensor]],
    pictures: Sequence[Mapping[str, Pictures]],
    gaps: Sequence[tuple[int, ...]],
) -> Iterator[Demonstration]:
    """Yield each whole episode."""
    for number, rows in enumerate(zip(*kinds, strict=True)):
        yield Demonstration(
            read.indices[number],
            read.tasks[number],
            *rows,
            gaps=gaps[number],
            pictures=pictures[number],
        )


def _pictures(
    root: Path,
    info: Mapping[str, Any],
    cameras: CameraChoice | None,
    read: Episodes,
    fps: float,
    skip_damaged: bool,
) -> tuple[Sequence[Mapping[str, Pictures]], set[int]]:
    """Return what cameras show of each episode, and the indices of those that are left out."""
    if cameras is None:
        return [{} for _ in read.indices], set()
    from pacnet.datasets.pictures.reading import read_pictures

    return read_pictures(root, info, cameras, read, fps, skip_damaged)


def _rate(path: Path, info: Mapping[str, Any], read: Episodes) -> float:
    """Return the frames per second that `meta/info.json` gives, or else the timestamps."""
    fps = info.get("fps")
    if is_rate(fps):
        return fps
    steps = (
        []
        if read.timestamps is None
        else [*map(np.diff, read.split(read.timestamps.astype(np.float64)))]
    )
    step = float(np.median(np.concatenate(steps))) if any(map(len, steps)) else 0.0
    if not step > 0 or not is_rate(1 / step):
        raise DatasetError(f"{path}: expected fps above 0 and finite, found {reprlib.repr(fps)}")
    rate = round(1 / step, 2) or 1 / step
    warnings.warn(
        f"meta/info.json gives no valid fps ({reprlib.repr(fps)}): the timestamps say {rate:g}",
        DatasetWarning,
        stacklevel=3,
    )
    return rate


def _taken(read: Episodes, only_where: str | None) -> list[NDArray[np.bool_]]:
    """Return which frames `[T]` of each episode are asked for."""
    if only_where is None:
        return read.split(np.ones(len(read.rows), dtype=np.bool_))
    rows = read.values[only_where]
    if rows.shape[1] != 1 or not np.isin(rows, (0, 1)).all():
        raise DatasetError(f"expected {only_where!r} to be true or false in each frame")
    return read.split(rows[:, 0] == 1)


def _runs(whole: Demonstration, taken: NDArray[np.bool_]) -> list[Demonstration]:
    """Return the parts of an episode in which all frames are asked for."""
    if taken.all():
        return [whole]
    bounds = np.flatnonzero(np.diff(taken, prepend=False, append=False)).reshape(-1, 2)
    return [whole.part(first, end) for first, end in bounds.tolist()]


def _check_finite(
    read: Episodes, features: Iterable[str], taken: Sequence[NDArray[np.bool_]]
) -> None:
    """Refuse numbers that are not finite, and name the episodes to leave out."""
    mask = np.concatenate(taken)
    for feature in features:
        bad = ~np.isfinite(read.values[feature]) & mask[:, None]
        if not bad.any():
            continue
        row, dimension = (int(number) for number in np.argwhere(bad)[0])
        episode, frame = read.place(row)
        several = sorted({read.place(int(row))[0] for row in np.flatnonzero(bad.any(axis=1))})
        raise DatasetError(
            f"expected finite numbers, found {int(bad.sum())} others in {feature!r}, the first in "
            f"episode {episode}, frame {frame}, dimension {read.names[feature][dimension]!r}: "
            f"leave out what has them with --exclude {numbers_text(several)} (exclude= in Python)"
        )


def _gaps(fps: float, read: Episodes) -> list[tuple[int, ...]]:
    """Return the frames of each episode before which time is missing, after telling of them."""
    timing = find_gaps(fps, read.indices, read.lengths, read.timestamps, read.frame_indices)
    for note in timing.notes:
        warnings.warn(note, DatasetWarning, stacklevel=3)
    return timing.gaps


def _tell_wraps(read: Episodes, features: Iterable[str], fps: float) -> None:
    """Warn of angles that jump by a full turn."""
    for feature in features:
        values = read.split(read.values[feature])
        for note in find_wraps(values, read.indices, read.names[feature], fps, feature):
            warnings.warn(note, DatasetWarning, stacklevel=3)
