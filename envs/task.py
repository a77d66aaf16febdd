"""The task's measures: the rim reaches the mouth, and the glass stands at its place again."""

from typing import NamedTuple

import numpy as np

from envs.scene import GLASS_HEIGHT, GLASS_RADIUS, GLASS_REST_Z

MOUTH_DISTANCE = 0.03  # [m] rim to mouth, for a drink
PLACE_DISTANCE = 0.03  # [m] horizontally from where the glass stood, at the end
UPRIGHT_TILT = 0.1  # [rad] a glass that tilts less stands upright
STANDING_HEIGHT = 0.01  # [m] and its middle is no further than this from a standing glass's


class TaskMeasures(NamedTuple):
    """Measures of one body's glass at one instant."""

    rim_to_mouth: float  # [m]
    glass_from_place: float  # [m], horizontal
    glass_tilt: float  # [rad]
    stands_at_place: bool  # upright on the table, near where it stood


def measure(
    mouth: np.ndarray, glass: np.ndarray, axis: np.ndarray, place: np.ndarray
) -> TaskMeasures:
    """Measures one body's glass.

    Args:
        mouth: (3,) [m], body frame, as all others.
        glass: the glass's middle (3,) [m].
        axis: the glass's axis (3,), of length one.
        place: where the glass stood at first (2,) [m].

    Returns:
        The measures.
    """
    offset = mouth - glass
    along = float(offset @ axis)
    across = max(float(offset @ offset) - along**2, 0.0) ** 0.5
    rim_to_mouth = float(np.hypot(along - GLASS_HEIGHT / 2, across - GLASS_RADIUS))
    tilt = float(np.arccos(np.clip(axis[2], -1.0, 1.0)))
    from_place = float(np.hypot(glass[0] - place[0], glass[1] - place[1]))
    stands = tilt <= UPRIGHT_TILT and abs(float(glass[2]) - GLASS_REST_Z) <= STANDING_HEIGHT
    return TaskMeasures(rim_to_mouth, from_place, tilt, stands and from_place <= PLACE_DISTANCE)
