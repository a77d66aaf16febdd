"""Checks of the arguments, options and actions of the environment of Experiment 1."""

import math
from typing import Any, NamedTuple

import numpy as np

from envs.glass_offset import checked_offset
from envs.humanoid import JOINTS
from envs.mishaps import MISHAPS
from envs.own_glass import OWN_GLASSES
from envs.presence import PRESENCES
from envs.scene import MAX_HEIGHT, MAX_WIDTH

_CHOICES = {"mishap": MISHAPS, "demonstrator": PRESENCES, "own_glass": OWN_GLASSES}


class ResetOptions(NamedTuple):
    """The optional settings of an episode."""

    mishap: str | None = None  # of MISHAPS
    # [2] [m] of both glasses from their place, in each body's frame
    glass_offset: np.ndarray | tuple[float, float] = (0.0, 0.0)
    demonstrator: str = "present"  # of PRESENCES
    own_glass: str = "standing"  # of OWN_GLASSES


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
    given = dict(options or {})
    if not set(given) <= set(ResetOptions._fields):
        expected = ", ".join(f"{name!r}: one of {choices}" for name, choices in _CHOICES.items())
        raise ValueError(
            f"options must be {{'glass_offset': (dx, dy), {expected}}}, or some of these, "
            f"got {options!r}"
        )
    for name, choices in _CHOICES.items():
        if name in given:
            check_choice(name, given[name], choices)
    if "glass_offset" in given:
        given["glass_offset"] = checked_offset(given["glass_offset"])
    return ResetOptions(**given)


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
