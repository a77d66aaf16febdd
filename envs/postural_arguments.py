"""Checks of the arguments, options and actions of the environment of Experiment 1."""

import math
from typing import Any, NamedTuple

import numpy as np

from envs.glass_offset import checked_offset
from envs.humanoid import JOINTS
from envs.mishaps import MISHAPS
from envs.scene import MAX_HEIGHT, MAX_WIDTH


class ResetOptions(NamedTuple):
    """The optional settings of an episode."""

    mishap: str | None  # of MISHAPS
    glass_offset: np.ndarray  # [2] [m] of both glasses from their place, in each body's frame


def check_arguments(
    render_mode: str | None, pace: float, noise_scale: float, width: int, height: int
) -> None:
    """Refuse invalid arguments of the environment."""
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
    if not 0.1 <= pace <= 10:
        raise ValueError(f"pace must be between 0.1 and 10, got {pace}")
    if not 0 <= noise_scale < float("inf"):
        raise ValueError(f"noise_scale must be finite and at least 0, got {noise_scale}")
    if not (0 < width <= MAX_WIDTH and 0 < height <= MAX_HEIGHT):
        raise ValueError(
            f"width and height must be within {MAX_WIDTH} x {MAX_HEIGHT}, got {width} x {height}"
        )


def check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Refuse a value that is not one of the choices."""
    if value not in choices:
        raise ValueError(f"{name} must be one of {choices}, got {value!r}")


def checked_options(options: dict[str, Any] | None) -> ResetOptions:
    """Return the options of a reset; the defaults are an ordinary episode."""
    given = options or {}
    if not set(given) <= set(ResetOptions._fields):
        raise ValueError(
            f"options must be {{'mishap': one of {MISHAPS}, 'glass_offset': (dx, dy)}}, "
            f"either or both, got {options!r}"
        )
    if "mishap" in given:
        check_choice("mishap", given["mishap"], MISHAPS)
    offset = given.get("glass_offset", (0.0, 0.0))
    return ResetOptions(given.get("mishap"), checked_offset(offset))


def checked_joints(name: str, value: np.ndarray) -> np.ndarray:
    """Return the value as float64 `[11]`, or raise a ValueError."""
    expected = f"{name} must be {len(JOINTS)} finite numbers"
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{expected}, got {value!r}") from error
    if numbers.shape != (len(JOINTS),):
        raise ValueError(f"{expected}, got shape {numbers.shape}")
    if not all(map(math.isfinite, numbers.tolist())):
        raise ValueError(f"{expected}, got {value!r}")
    return numbers
