"""Checks of postures and places that a caller gives to a model of a body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.validation import describe
from pacnet.forward_models.config import KinematicModelConfig
from pacnet.forward_models.kinematics_fit import least_postures

Array = NDArray[np.float64]

_UNIT = 1e-3  # by which the length of a quaternion may differ from 1


class Postures(NamedTuple):
    """N postures, and where the hand was seen; float64."""

    angles: Array
    """`[N, J]` [rad]."""
    places: Array
    """`[N, 3]`."""
    turns: Array
    """Unit quaternions, `[N, 4]`."""


def check_postures(joints: Sequence[str], angles: Any, places: Any, turns: Any) -> Postures:
    """Return what a fit is given as arrays, after checking it.

    Raises:
        ValueError: not such rows of finite numbers, unequal numbers of rows, or too few.
    """
    count = check_names(joints)
    shown = check_array("angles", angles, (None, count))
    rows = len(shown)
    postures = Postures(
        shown, check_array("places", places, (rows, 3)), check_turns(turns, (rows, 4))
    )
    needed = least_postures(count)
    if rows < needed:
        raise ValueError(f"expected at least {needed} postures of {count} angles, got {rows}")
    return postures


def check_names(joints: Sequence[str]) -> int:
    """Return how many joints there are; raise a ValueError unless their names are all different."""
    return len(KinematicModelConfig(joints, (0,)).joints)  # pyright: ignore[reportArgumentType]


def check_range(joints: Sequence[str], lowest: Any, highest: Any) -> tuple[Array, Array]:
    """Return the range of angles as arrays `[J]`, after checking it."""
    count = check_names(joints)
    low, high = check_array("lowest", lowest, (count,)), check_array("highest", highest, (count,))
    if (low > high).any():
        joint = joints[int(np.argmax(low > high))]
        raise ValueError(f"expected lowest ≤ highest, got another range of {joint!r}")
    return low, high


def check_turns(turns: Any, shape: tuple[int | None, ...]) -> Array:
    """Return unit quaternions as an array of a shape, after checking them."""
    found = check_array("turns", turns, shape)
    length = np.linalg.norm(found, axis=-1, keepdims=True)
    if (np.abs(length - 1) > _UNIT).any():
        worst = float(length.flat[int(np.argmax(np.abs(length - 1)))])
        raise ValueError(f"expected unit quaternions w, x, y, z as turns, got length {worst:.4g}")
    return found / length


def check_array(name: str, value: Any, shape: tuple[int | None, ...]) -> Array:
    """Return an array or tensor of finite numbers as float64, after checking it.

    Args:
        name: for the message.
        value: the array.
        shape: of it; None for any length.

    Raises:
        ValueError: none such.
    """
    wanted = f"expected {name} as an array [{', '.join(str(n or 'N') for n in shape)}] of numbers"
    if isinstance(value, Tensor):
        value = value.detach().cpu().numpy()
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{wanted}, got {describe(value)}") from error
    fits = array.ndim == len(shape)
    if not fits or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        raise ValueError(f"{wanted}, got {list(array.shape)}")
    if not np.isfinite(array).all():
        raise ValueError(f"expected finite {name}, got {array[~np.isfinite(array)][0]}")
    return array
