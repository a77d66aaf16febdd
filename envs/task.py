"""The tasks' measures: what was done with a glass, and whether it stands where it ought to.

A drink takes the rim to the mouth and the glass back to its place. A toast is a drink before which
the glass was raised in greeting. A move takes the glass to another place, and nobody drinks.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.scene import GLASS_HEIGHT, GLASS_RADIUS, GLASS_REST_Z

MOUTH_DISTANCE = 0.03  # [m] rim to mouth, for a drink
PLACE_DISTANCE = 0.03  # [m] horizontally from where the glass ought to stand at the end
UPRIGHT_TILT = 0.1  # [rad] a glass that tilts less stands upright
STANDING_HEIGHT = 0.01  # [m] and its middle is no further than this from a standing glass's
TOAST_POINT = (0.54, -0.17, 0.46)  # [m] of the glass's middle, body frame
TOAST_DISTANCE = 0.06  # [m] from there, for a toast; a drink stays twice as far off
MOVE = (-0.06, -0.21)  # [m] by which a move takes the glass towards its body and to the right


class TaskMeasures(NamedTuple):
    """Measures of one body's glass at one instant."""

    rim_to_mouth: float  # [m]
    glass_from_place: float  # [m], horizontal
    glass_tilt: float  # [rad]
    stands_at_place: bool  # upright on the table, near where it ought to stand
    glass_to_toast: float  # [m]


class Deeds:
    """What one body has done with its glass since the episode began."""

    def __init__(self) -> None:
        """Starts with nothing done."""
        self.mouth_reached = False
        self.toasted = False

    def update(self, measured: TaskMeasures) -> None:
        """Takes note of one instant; a toast counts only before the first sip."""
        self.mouth_reached |= measured.rim_to_mouth <= MOUTH_DISTANCE
        self.toasted |= not self.mouth_reached and measured.glass_to_toast <= TOAST_DISTANCE

    def fulfil(self, behaviour: str) -> bool:
        """Whether they are those of "drink", "toast" or "move"."""
        if behaviour == "move":
            return not self.mouth_reached
        return self.mouth_reached and self.toasted == (behaviour == "toast")


def final_place(behaviour: str, place: np.ndarray) -> np.ndarray:
    """Where a glass ought to stand at the end (2,) [m], which stood at `place` (2,) [m]."""
    return place + MOVE if behaviour == "move" else place


def measure(
    mouth: np.ndarray, glass: np.ndarray, axis: np.ndarray, place: np.ndarray
) -> TaskMeasures:
    """Measures one body's glass.

    Args:
        mouth: (3,) [m], body frame, as all others.
        glass: the glass's middle (3,) [m].
        axis: the glass's axis (3,), of length one.
        place: where the glass ought to stand at the end (2,) [m].

    Returns:
        The measures.
    """
    offset = mouth - glass
    along = float(offset.dot(axis))
    across = max(float(offset.dot(offset)) - along**2, 0.0) ** 0.5
    # The length of a complex number is np.hypot's, which takes six times as long.
    rim_to_mouth = abs(complex(along - GLASS_HEIGHT / 2, across - GLASS_RADIUS))
    tilt = float(np.arccos(min(max(float(axis[2]), -1.0), 1.0)))
    (x, y, z), (x_place, y_place) = glass.tolist(), place.tolist()
    from_place = abs(complex(x - x_place, y - y_place))
    stands = tilt <= UPRIGHT_TILT and abs(z - GLASS_REST_Z) <= STANDING_HEIGHT
    at_place = stands and from_place <= PLACE_DISTANCE
    to_toast = math.dist((x, y, z), TOAST_POINT)
    return TaskMeasures(rim_to_mouth, from_place, tilt, at_place, to_toast)
