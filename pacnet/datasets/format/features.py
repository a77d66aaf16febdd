"""The features of a recording, and checks of the values that are recorded."""

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, SupportsIndex, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Columns that LeRobot's format adds to the features: name -> dtype.
INDEX_COLUMNS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
RESERVED = (*INDEX_COLUMNS, "task")
# Stored dtype -> accepted dtypes, in words.
STORED = {"float32": "float32 or float64", "int64": "integers", "bool": "booleans"}

_MAX_CAMERA_BYTES = 100
_MAX_SIDE = 8192  # pixels

Arrays = dict[str, NDArray[np.generic]]
"""Feature name -> values, of the dtype that is stored."""


@dataclass(frozen=True)
class Feature:
    """A feature of a recording; those given by their names alone are float32.

    Attributes:
        names: names of its dimensions.
        dtype: `float32`, `int64` or `bool`.
    """

    names: Sequence[str]
    dtype: str = "float32"


@dataclass(frozen=True)
class Picture:
    """A camera of a recording: red, green and blue, uint8 `[height, width, 3]` in each frame.

    Videos halve the resolution of colours, so both sides are even.

    Attributes:
        height: number of rows [pixels].
        width: number of columns [pixels].
    """

    height: int
    width: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and number of channels."""
        return self.height, self.width, 3


Features = Mapping[str, Sequence[str] | Feature | Picture]
"""Feature name -> names of its dimensions, or a `Feature`, or the `Picture` of a camera."""


class Recording(NamedTuple):
    """What all episodes of a recording have in common."""

    fps: int  # [1/s]
    features: dict[str, Feature]  # of numbers
    robot_type: str | None
    cameras: Mapping[str, Picture] = MappingProxyType({})


def checked_recording(fps: SupportsIndex, features: Features, robot_type: str | None) -> Recording:
    """Return a recording with its features as they are stored, or raise a ValueError."""
    try:
        rate = 0 if isinstance(fps, bool) else operator.index(fps)
    except TypeError:
        rate = 0
    if not 0 < rate < 2**31:
        bound = "above 0" if rate <= 0 else "below 2**31"
        raise ValueError(f"expected fps as an integer {bound}, got {fps!r}")
    if robot_type is not None and not is_text(robot_type):
        raise ValueError(f"expected robot_type as text or None, got {robot_type!r}")
    if not isinstance(features, Mapping):
        return Recording(rate, checked_features(features), robot_type)
    cameras = {name: one for name, one in features.items() if isinstance(one, Picture)}
    numbers = {name: one for name, one in features.items() if not isinstance(one, Picture)}
    for name, picture in cameras.items():
        _check_camera(name, picture)
    return Recording(rate, checked_features(numbers), robot_type, cameras)


def is_text(text: object) -> TypeGuard[str]:
    """Return whether this is text that UTF-8 can encode: half a surrogate pair is not."""
    return isinstance(text, str) and not any("\ud800" <= letter <= "\udfff" for letter in text)


def checked_features(features: Mapping[str, Sequence[str] | Feature]) -> dict[str, Feature]:
    """Return the features as they are stored, or raise a ValueError."""
    if not isinstance(features, Mapping) or not features:
        raise ValueError(f"expected at least one feature in a mapping, got {features!r}")
    return {name: _checked_feature(name, feature) for name, feature in features.items()}


def _check_name(name: object) -> None:
    if not is_text(name) or name in (*RESERVED, "", ".", "..") or "/" in name:
        raise ValueError(
            f"expected feature names as text without '/', not empty, and other than '.', '..', "
            f"{', '.join(RESERVED)}, got {name!r}"
        )


def _check_camera(name: str, picture: Picture) -> None:
    """Refuse what cannot be a camera; its name becomes that of a folder."""
    _check_name(name)
    if set(name) & set("\0\\:") or len(name.encode()) > _MAX_CAMERA_BYTES:
        raise ValueError(
            f"expected the name of a camera without ':' and '\\', of {_MAX_CAMERA_BYTES} bytes at "
            f"most, got {name!r}"
        )
    sides = picture.height, picture.width
    if any(type(side) is not int or side % 2 or not 0 < side <= _MAX_SIDE for side in sides):
        raise ValueError(
            f"expected {name!r} with an even height and width, 2 to {_MAX_SIDE} pixels, got "
            f"{picture}"
        )


def _checked_feature(name: str, feature: Sequence[str] | Feature) -> Feature:
    _check_name(name)
    names, dtype = (
        (feature.names, feature.dtype) if isinstance(feature, Feature) else (feature, "float32")
    )
    # A mapping would pass as its keys.
    are_texts = isinstance(names, list | tuple) and names and all(map(is_text, names))
    if not are_texts or len(set(names)) < len(names):
        hint = ": give its names alone, or a Feature" if isinstance(names, Mapping) else ""
        raise ValueError(
            f"expected {name!r} to have distinct dimension names as text, in a list or tuple, "
            f"got {names!r}{hint}"
        )
    if not isinstance(dtype, str) or dtype not in STORED:
        raise ValueError(f"expected {name!r} of dtype {', '.join(STORED)}, got {dtype!r}")
    return Feature(tuple(names), dtype)


def checked_episode(
    features: Mapping[str, Feature],
    values: Mapping[str, ArrayLike],
    cameras: Mapping[str, Picture] = MappingProxyType({}),
) -> Arrays:
    """Return copies of an episode's values, `[T, D]` each, all of one T > 0, as they are stored.

    Those of cameras are `[T, H, W, 3]`, and are not copied.

    Raises:
        ValueError: a feature is missing or unknown, or an array is of another shape or dtype,
            empty, not finite in float32, beyond int64, or not as long as the others.
    """
    _check_names({**features, **cameras}, values)
    columns = {name: _stored(name, one, values[name], 2) for name, one in features.items()}
    columns |= {name: _pictures(name, one, values[name], 4) for name, one in cameras.items()}
    lengths = {name: len(rows) for name, rows in columns.items()}
    if len(set(lengths.values())) != 1:
        raise ValueError(f"expected as many frames in every feature, got {lengths}")
    return columns


def checked_frame(
    features: Mapping[str, Feature],
    values: Mapping[str, ArrayLike],
    cameras: Mapping[str, Picture] = MappingProxyType({}),
) -> Arrays:
    """Return copies of one frame's values, `[D]` each, as they are stored; [] will do for D = 1.

    Those of cameras are `[H, W, 3]`.

    Raises:
        ValueError: as `checked_episode`.
    """
    _check_names({**features, **cameras}, values)
    row = {name: _stored(name, one, values[name], 1) for name, one in features.items()}
    shown = {name: _pictures(name, one, values[name], 3) for name, one in cameras.items()}
    return row | {name: np.array(picture) for name, picture in shown.items()}


def _pictures(name: str, picture: Picture, values: ArrayLike, ndim: int) -> NDArray[np.generic]:
    """Return a camera's pictures, `[H, W, 3]` or `[T, H, W, 3]`, after checking them."""
    shape = f"{[*picture.shape]}" if ndim == 3 else f"[T > 0, {str([*picture.shape])[1:]}"
    expected = f"expected {name!r} as uint8 of shape {shape}"
    array = _to_array(values, "uint8", expected)
    if array.ndim != ndim or array.shape[-3:] != picture.shape or len(array) == 0:
        raise ValueError(f"{expected}, got shape {list(array.shape)}")
    return array


def _check_names(features: Mapping[str, object], values: Mapping[str, ArrayLike]) -> None:
    expected = f"expected the features {sorted(features)}"
    if not isinstance(values, Mapping):
        raise ValueError(f"{expected} with their values in a mapping, got {type(values).__name__}")
    if set(values) != set(features):
        raise ValueError(f"{expected}, got {sorted(map(str, values))}")


def _stored(name: str, feature: Feature, values: ArrayLike, ndim: int) -> NDArray[np.generic]:
    """Return a copy of a feature's values, `[D]` or `[T, D]`, in the dtype that is stored."""
    dimension = len(feature.names)
    shape = f"[T > 0, {dimension}]" if ndim == 2 else f"[{dimension}]"
    expected = f"expected {name!r} as {STORED[feature.dtype]} of shape {shape}"
    array = _to_array(values, feature.dtype, expected)
    if ndim == dimension == 1 and array.ndim == 0:
        array = array[None]
    if array.ndim != ndim or array.shape[-1] != dimension or len(array) == 0:
        raise ValueError(f"{expected}, got shape {list(array.shape)}")
    if array.dtype == np.uint64 and array.max() > np.iinfo(np.int64).max:
        raise ValueError(f"{expected} below 2**63, got {array.max()}")
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused
        copy = np.array(array, dtype=feature.dtype, order="C")
    bad = np.argwhere(~np.isfinite(copy))
    if len(bad):
        got = f"{len(bad)} others, the first in row {bad[0][0]}" if ndim == 2 else copy.tolist()
        raise ValueError(f"{expected} and finite, got {got}")
    return copy


def _to_array(values: ArrayLike, dtype: str, expected: str) -> NDArray[np.generic]:
    """Return values as an array of a dtype that is accepted for the stored one."""
    if isinstance(values, np.ma.MaskedArray):
        raise ValueError(f"{expected}, got a masked array, which has gaps")
    try:
        array = np.asarray(values)
    except (RuntimeError, TypeError, ValueError) as error:  # tensors with gradients, ragged rows
        raise ValueError(f"{expected}, got what numpy cannot take: {error}") from None
    if dtype == "uint8":
        accepted = array.dtype == np.uint8
    elif dtype == "float32":
        accepted = array.dtype in (np.float32, np.float64)
    else:
        accepted = array.dtype.kind in ("iu" if dtype == "int64" else "b")
    if not accepted:
        raise ValueError(f"{expected}, got dtype {array.dtype}")
    return array
