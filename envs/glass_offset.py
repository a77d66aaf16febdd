"""Other places of the glasses on the table than the usual one of the demonstrations.

Both glasses have the same offset from their place, each in its own body's frame.
"""

import math

import numpy as np

from envs.scene import GLASS_PLACE, ROOT_DISTANCE

MAX_OFFSET = 0.16  # [m] limited by the arms' reach and the table
CLEARANCE = 0.06  # [m] least distance of a glass from the table's middle
# Counterclockwise from forwards [rad]: not towards the other glass, nor where the way to the mouth
# would pass the place of a toast.
DIRECTIONS = (math.radians(60.0), math.radians(255.0))
_FREE = (
    f"a whole drink is possible {math.degrees(DIRECTIONS[0]):.0f} to "
    f"{math.degrees(DIRECTIONS[1]):.0f} degrees counterclockwise from forwards, "
    f"up to {MAX_OFFSET} m away"
)


def draw_offset(rng: np.random.Generator, distance: float) -> np.ndarray:
    """Return an offset in a direction in which a whole drink is possible.

    Args:
        rng: Decides the direction.
        distance: From the usual place [m], at most `MAX_OFFSET`.

    Returns:
        The offset `[2]` [m], in the body frame.
    """
    direction = rng.uniform(*DIRECTIONS)
    return distance * np.array((math.cos(direction), math.sin(direction)))


def draw_within(rng: np.random.Generator, radius: float) -> np.ndarray:
    """Return an offset, uniform in area, in a direction in which a whole drink is possible.

    Args:
        rng: Decides direction and distance.
        radius: Largest distance from the usual place [m], at most `MAX_OFFSET`.

    Returns:
        The offset `[2]` [m], in the body frame.

    Raises:
        ValueError: The radius is out of its range.
    """
    if not 0 <= radius <= MAX_OFFSET:
        raise ValueError(f"expected radius within 0 and {MAX_OFFSET} m, got {radius!r}")
    return draw_offset(rng, radius * math.sqrt(rng.uniform()))


def checked_offset(value: object) -> np.ndarray:
    """Return the offset as float64 `[2]` [m], or raise a ValueError."""
    wanted = f"expected glass_offset as (dx, dy), at most {MAX_OFFSET} m long"  # stays on the table
    try:
        offset = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{wanted}, got {value!r}; {_FREE}") from error
    if offset.shape != (2,) or not math.hypot(*offset.tolist()) <= MAX_OFFSET:
        raise ValueError(f"{wanted}, got {value!r}; {_FREE}")
    x, y = (offset + GLASS_PLACE).tolist()
    to_middle = math.hypot(x - ROOT_DISTANCE / 2, y)
    if to_middle < CLEARANCE:
        raise ValueError(
            f"expected glass_offset to keep a glass {CLEARANCE} m from the table's middle, away "
            f"from the other one, got {value!r}, {to_middle:.3f} m from the middle; "
            f"{_FREE}"
        )
    return offset
