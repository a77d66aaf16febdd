"""Where else on the table the glasses can stand: away from the place that demonstrations begin at.

Both glasses stand away from their place alike, each as its own body sees it.
"""

import math

import numpy as np

from envs.scene import GLASS_PLACE, ROOT_DISTANCE

MAX_OFFSET = 0.16  # [m] that far the arms reach, and the glasses stand on the table
CLEARANCE = 0.06  # [m] of a glass's middle from the table's, beyond which is the other glass
# From forwards, to the left [rad]: away from the other glass, and from where the way to the mouth
# leads past the place of a toast.
DIRECTIONS = (math.radians(60.0), math.radians(255.0))


def draw_offset(rng: np.random.Generator, distance: float) -> np.ndarray:
    """An offset in a direction in which everything about a drink can be done.

    Args:
        rng: decides the direction.
        distance: from the usual place [m], at most `MAX_OFFSET`.

    Returns:
        The offset (2,) [m], in the body frame.
    """
    direction = rng.uniform(*DIRECTIONS)
    return distance * np.array((math.cos(direction), math.sin(direction)))


def checked_offset(value: object) -> np.ndarray:
    """The offset as float64 (2,) [m], or a ValueError."""
    wanted = f"expected glass_offset as (dx, dy), at most {MAX_OFFSET} m long"
    try:
        offset = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{wanted}, got {value!r}") from error
    if offset.shape != (2,) or not math.hypot(*offset.tolist()) <= MAX_OFFSET:
        raise ValueError(f"{wanted}, got {value!r}")
    x, y = (offset + GLASS_PLACE).tolist()
    to_middle = math.hypot(x - ROOT_DISTANCE / 2, y)
    if to_middle < CLEARANCE:
        raise ValueError(
            f"expected glass_offset to keep a glass {CLEARANCE} m from the table's middle, where "
            f"the other one would be in its way, got {value!r}, {to_middle:.3f} m from there"
        )
    return offset
