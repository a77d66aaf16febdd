"""What the environment of Experiment 1 accepts as arguments, options and actions."""

import math
from typing import Any

import numpy as np

from envs.humanoid import JOINTS
from envs.mishaps import MISHAPS
from envs.scene import MAX_HEIGHT, MAX_WIDTH


def check_arguments(
    render_mode: str | None, pace: float, noise_scale: float, width: int, height: int
) -> None:
    """Refuses what the environment cannot be built with."""
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
    """Refuses what is not one of the choices."""
    if value not in choices:
        raise ValueError(f"{name} must be one of {choices}, got {value!r}")


def checked_mishap(options: dict[str, Any] | None) -> str | None:
    """The mishap that the options of a reset ask for, or None."""
    if not options:
        return None
    if set(options) != {"mishap"}:
        raise ValueError(f"options must be {{'mishap': one of {MISHAPS}}}, got {options!r}")
    check_choice("mishap", options["mishap"], MISHAPS)
    return options["mishap"]


def checked_joints(name: str, value: np.ndarray) -> np.ndarray:
    """The value as float64 (11,), or a ValueError."""
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
