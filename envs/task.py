"""Measures of the tasks: what was done with a glass, and whether it stands at its final place.

A drink takes the rim to the mouth and the glass back to its place. In a toast the glass is raised
before the drink. A move takes the glass to another place, without a drink. Aside is a drink after
which the glass is put down beside the place it was taken from.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.scene import GLASS_HEIGHT, GLASS_RADIUS, GLASS_REST_Z

MOUTH_DISTANCE = 0.03  # [m] rim to mouth, for a drink
PLACE_DISTANCE = 0.03  # [m] horizontally from the final place
UPRIGHT_TILT = 0.1  # [rad] largest tilt of an upright glass
STANDING_HEIGHT = 0.01  # [m] largest deviation of its height from a standing glass
TOAST_POINT = (0.54, -0.17, 0.46)  # [m] of the glass's middle, body frame
TOAST_DISTANCE = 0.06  # [m] largest distance from there in a toast; a drink stays twice as far away
MOVE = (-0.06, -0.21)  # [m] by which a move takes the glass towards its body and to the right
ASIDE = (0.0, -0.10)  # [m] to the right, where a glass is put down aside
_CARRIED = {"move": MOVE, "aside": ASIDE}  # [m]


class TaskMeasures(NamedTuple):
    """Measures of one body's glass at one instant."""

    rim_to_mouth: float  # [m]
    glass_from_place: float  # [m], horizontal
    glass_tilt: float  # [rad]
    stands_at_place: bool  # upright on the table, near its final place
    glass_to_toast: float  # [m]


class Deeds:
    """What one body has done with its glass in this episode."""

    def __init__(self) -> None:
        """Start with nothing done."""
        self.mouth_reached = False
        self.toasted = False

    def update(self, measured: TaskMeasures) -> None:
        """Record one instant; a toast counts only before the first sip."""
        self.mouth_reached |= measured.rim_to_mouth <= MOUTH_DISTANCE
        self.toasted |= not self.mouth_reached and measured.glass_to_toast <= TOAST_DISTANCE

    def fulfil(self, behaviour: str) -> bool:
        """Return whether they complete "drink", "toast", "move" or "aside"."""
        if behaviour == "move":
            return not self.mouth_reached
        return self.mouth_reached and self.toasted == (behaviour == "toast")


def final_place(behaviour: str, place: np.ndarray) -> np.ndarray:
    """Return the place `[2]` [m] at the end of a glass that stood at `place` `[2]` [m]."""
    return place + _CARRIED.get(behaviour, (0.0, 0.0))


def measure(
    mouth: np.ndarray, glass: np.ndarray, axis: np.ndarray, place: np.ndarray
) -> TaskMeasures:
    """Measure one body's glass.

    Args:
        mouth: Its position `[3]` [m], in the body frame like all others.
        glass: The glass's middle `[3]` [m].
        axis: The glass's axis `[3]`, of length one.
        place: Final place of the glass `[2]` [m].

    Returns:
        The measures.
    """
    offset = mouth - glass
    along = float(offset.dot(axis))
    across = max(float(offset.dot(offset)) - along**2, 0.0) ** 0.5
    # abs(complex) equals np.hypot, but is six times faster.
    rim_to_mouth = abs(complex(along - GLASS_HEIGHT / 2, across - GLASS_RADIUS))
    tilt = float(np.arccos(min(max(float(axis[2]), -1.0), 1.0)))
    (x, y, z), (x_place, y_place) = glass.tolist(), place.tolist()
    from_place = abs(complex(x - x_place, y - y_place))
    stands = tilt <= UPRIGHT_TILT and abs(z - GLASS_REST_Z) <= STANDING_HEIGHT
    at_place = stands and from_place <= PLACE_DISTANCE
    to_toast = math.dist((x, y, z), TOAST_POINT)
    return TaskMeasures(rim_to_mouth, from_place, tilt, at_place, to_toast)
