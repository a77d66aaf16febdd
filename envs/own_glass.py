"""Where the imitator's own glass is when it is not where the demonstrator's is: nothing to drink.

Poses are `[7]`: position [m] in the body frame, and the quaternion of the turn from a standing
glass.
"""

import math

import numpy as np

from envs.scene import GLASS_HEIGHT, GLASS_REST_Z, GLASS_SIDE, ROOT_HEIGHT

OWN_GLASSES = ("standing", "tipped", "far", "absent")

# [m] on the table far to the left, 6 cm or more from where the right hand can take a glass, and
# away from all that the demonstrator does.
FAR_X, FAR_Y = (0.46, 0.58), (0.42, 0.47)
_LYING_Z = GLASS_REST_Z - GLASS_HEIGHT / 2 + GLASS_SIDE  # [m]
_STANDING = (1.0, 0.0, 0.0, 0.0)
_REMOVED = (-1.0, 0.0, GLASS_HEIGHT / 2 - ROOT_HEIGHT)  # [m] on the floor behind the body


def own_glass_pose(kind: str, place: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
    """Return where the imitator's glass is.

    Args:
        kind: One of OWN_GLASSES.
        place: Of the demonstrator's glass `[2]` [m], in its body frame.
        rng: Decides the direction of a tipped glass and the place of a far one.

    Returns:
        The pose `[7]`, or None for a glass that stands at `place` too.
    """
    if kind == "tipped":
        return np.array((*place, _LYING_Z, *_lying(rng.uniform(-math.pi, math.pi))))
    if kind == "far":
        return np.array((rng.uniform(*FAR_X), rng.uniform(*FAR_Y), GLASS_REST_Z, *_STANDING))
    if kind == "absent":
        return np.array((*_REMOVED, *_STANDING))
    return None


def _lying(direction: float) -> tuple[float, ...]:
    """Return the quaternion that lays the glass's axis [rad] counterclockwise from forwards."""
    # A quarter turn about y, then `direction` about z: a side of the box that collides is below.
    half = math.sqrt(0.5)
    cosine, sine = half * math.cos(direction / 2), half * math.sin(direction / 2)
    return cosine, -sine, cosine, sine
