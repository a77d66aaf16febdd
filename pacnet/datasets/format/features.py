"""What all episodes of a recording have in common, and whether an episode fits."""

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, SupportsIndex, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Columns that LeRobot's format fills in by itself.
RESERVED = ("timestamp", "frame_index", "episode_index", "index", "task_index", "task")
STORED = {
    "float32": "float32 or float64",
    "int64": "integers",
    "bool": "booleans",
}  # dtype -> what is accepted for it


@dataclass(frozen=True)
class Feature:
    """A feature that is not stored as float32, or is and says so.

    Attributes:
        names: Names of its dimensions.
        dtype: `float32`, `int64` or `bool`.
    """

    names: Sequence[str]
    dtype: str = "float32"


class Recording(NamedTuple):
    """What all episodes of a recording have in common.

    Attributes:
        fps: Frames per second [1/s].
        features: Feature name -> what it holds.
        robot_type: What was recorded, or None.
    """

    fps: int
    features: dict[str, Feature]
    robot_type: str | None


def checked_recording(
    fps: SupportsIndex, features: Mapping[str, Sequence[str] | Feature], robot_type: str | None
) -> Recording:
    """What a recording is of, as it is stored.

    Raises:
        ValueError: `fps` is not a positive integer below 2**31, the robot's type is no text, or as
            `checked_features`.
    """
    rate = 0 if isinstance(fps, bool) else _whole(fps)
    if not 0 < rate < 2**31:
        bound = "above 0" if rate <= 0 else "below 2**31"
        raise ValueError(f"expected fps as an integer {bound}, got {fps!r}")
    if robot_type is not None and not is_text(robot_type):
        raise ValueError(f"expected robot_type as text or None, got {robot_type!r}")
    return Recording(rate, checked_features(features), robot_type)


def is_text(words: object) -> TypeGuard[str]:
    """Whether these are words that files in UTF-8 can hold: none has half of a surrogate pair."""
    return isinstance(words, str) and not any("\ud800" <= letter <= "\udfff" for letter in words)


def _whole(number: SupportsIndex) -> int:
    """An integer of whatever kind, or 0."""
    try:
        return operator.index(number)
    except TypeError:
        return 0


def checked_features(features: Mapping[str, Sequence[str] | Feature]) -> dict[str, Feature]:
    """The features by name, those given by the names of their dimensions alone as float32.

    Raises:
        ValueError: There is none, one is without dimensions, has two of one name, no list or tuple
            of them, or another dtype, or its name is one that LeRobot cannot store.
    """
    if not isinstance(features, Mapping) or not features:
        raise ValueError(f"expected at least one feature in a mapping, got {features!r}")
    return {name: _checked_feature(name, told) for name, told in features.items()}


def _checked_feature(name: str, told: Sequence[str] | Feature) -> Feature:
    if not is_text(name) or name in (*RESERVED, "", ".", "..") or "/" in name:
        raise ValueError(
            f"expected feature names as text without '/', not empty, and other than '.', '..', "
            f"{', '.join(RESERVED)}, got {name!r}"
        )
    names, dtype = (told.names, told.dtype) if isinstance(told, Feature) else (told, "float32")
    if not _are_names(names):
        hint = ": give its names alone, or a Feature" if isinstance(names, Mapping) else ""
        raise ValueError(
            f"expected {name!r} to have distinct dimension names as text, in a list or tuple, "
            f"got {names!r}{hint}"
        )
    if not isinstance(dtype, str) or dtype not in STORED:
        raise ValueError(f"expected {name!r} of dtype {', '.join(STORED)}, got {dtype!r}")
    return Feature(tuple(names), dtype)


def _are_names(names: object) -> bool:
    """Whether these name dimensions; LeRobot's description of a feature would by its keys."""
    if not isinstance(names, list | tuple) or not names:
        return False
    return all(map(is_text, names)) and len(set(names)) == len(names)


def checked_frames(
    features: Mapping[str, Feature], frames: Mapping[str, ArrayLike]
) -> dict[str, NDArray[np.generic]]:
    """An episode's arrays as they are stored.

    Args:
        features: Feature name -> what it holds, at least one feature.
        frames: Feature name -> its values, [T, D].

    Returns:
        Feature name -> its values, [T, D] of the feature's dtype, all of one T.

    Raises:
        ValueError: A feature is missing or unknown, or an array is of another shape or dtype,
            empty, not finite in float32, beyond int64, or not as long as the others.
    """
    _check_given(features, frames)
    columns = {name: _checked_rows(name, frames[name], told) for name, told in features.items()}
    lengths = {name: len(rows) for name, rows in columns.items()}
    if len(set(lengths.values())) != 1:
        raise ValueError(f"expected as many frames in every feature, got {lengths}")
    return columns


def checked_frame(
    features: Mapping[str, Feature], frame: Mapping[str, ArrayLike]
) -> dict[str, NDArray[np.generic]]:
    """One frame's vectors as they are stored, copied.

    Args:
        features: Feature name -> what it holds, at least one feature.
        frame: Feature name -> its values, [D]; where D is 1, a number will do.

    Returns:
        Feature name -> its values, [D] of the feature's dtype.

    Raises:
        ValueError: A feature is missing or unknown, or its values are of another shape or dtype,
            not finite in float32, or beyond int64.
    """
    _check_given(features, frame)
    return {name: _checked_row(name, frame[name], told) for name, told in features.items()}


def _check_given(features: Mapping[str, Feature], given: Mapping[str, ArrayLike]) -> None:
    wanted = f"expected the features {sorted(features)}"
    if not isinstance(given, Mapping):
        raise ValueError(f"{wanted} with their values in a mapping, got {type(given).__name__}")
    if set(given) != set(features):
        raise ValueError(f"{wanted}, got {sorted(map(str, given))}")


def _checked_rows(name: str, values: ArrayLike, told: Feature) -> NDArray[np.generic]:
    """One feature's values, [T, D] of its dtype, or a ValueError."""
    dimension = len(told.names)
    wanted = f"expected {name!r} as {STORED[told.dtype]} of shape [T > 0, {dimension}]"
    rows = _array(values, told.dtype, wanted)
    if rows.ndim != 2 or rows.shape[1] != dimension or len(rows) == 0:
        raise ValueError(f"{wanted}, got shape {list(rows.shape)}")
    return _stored(rows, told.dtype, wanted)


def _checked_row(name: str, values: ArrayLike, told: Feature) -> NDArray[np.generic]:
    """One feature's values in a frame, [D] of its dtype, or a ValueError."""
    dimension = len(told.names)
    wanted = f"expected {name!r} as {STORED[told.dtype]} of shape [{dimension}]"
    row = _array(values, told.dtype, wanted)
    if dimension == 1 and row.ndim == 0:
        row = row[None]
    if row.shape != (dimension,):
        raise ValueError(f"{wanted}, got shape {list(row.shape)}")
    return _stored(row, told.dtype, wanted)


def _array(values: ArrayLike, stored: str, wanted: str) -> NDArray[np.generic]:
    """Values of a dtype that is accepted for the one that is stored."""
    if isinstance(values, np.ma.MaskedArray):
        raise ValueError(f"{wanted}, got a masked array, which has gaps")
    try:
        rows = np.asarray(values)
    except (RuntimeError, TypeError, ValueError) as error:  # tensors with gradients, ragged rows
        raise ValueError(f"{wanted}, got what numpy cannot take: {error}") from None
    if stored == "float32":
        accepted = rows.dtype in (np.float32, np.float64)
    else:
        accepted = rows.dtype.kind in ("iu" if stored == "int64" else "b")
    if not accepted:
        raise ValueError(f"{wanted}, got dtype {rows.dtype}")
    return rows


def _stored(rows: NDArray[np.generic], dtype: str, wanted: str) -> NDArray[np.generic]:
    """A copy in the dtype that is stored, which holds all of the values."""
    if rows.dtype == np.uint64 and rows.max() > np.iinfo(np.int64).max:
        raise ValueError(f"{wanted} below 2**63, got {rows.max()}")
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        copy = np.array(rows, dtype=dtype, order="C")
    bad = np.argwhere(~np.isfinite(copy))
    if len(bad):
        others = f"{len(bad)} others, the first in row {bad[0][0]}"
        raise ValueError(f"{wanted} and finite, got {others if rows.ndim == 2 else rows.tolist()}")
    return copy
