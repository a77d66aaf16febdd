"""Residuals of the inverse kinematics of a body with a glass fixed in its hand.

Positions are in the body frame.
"""

from typing import NamedTuple

import numpy as np

from envs.kinematics import BodyPose
from envs.scene import GLASS_HEIGHT, GLASS_RADIUS, GRIP_HEIGHT

AXIS_WEIGHT = 0.05  # [m/rad] weight of an error of the tilt

UP = np.array((0.0, 0.0, 1.0))


def hold_error(pose: BodyPose, glass: np.ndarray) -> np.ndarray:
    """Return the residuals of a hand about to hold a standing glass, thumb up.

    Args:
        pose: Of the body.
        glass: The glass's middle `[3]` [m].

    Returns:
        Residuals `[6]` [m].
    """
    point = glass + GRIP_HEIGHT * UP
    thumb = pose.hand[:, 0]
    return np.concatenate([pose.grip - point, 0.2 * AXIS_WEIGHT * (thumb - UP)])


class HeldGlass(NamedTuple):
    """A glass fixed in the hand: its middle and its axis in the hand's frame, from the grip."""

    centre: np.ndarray  # [3] [m]
    axis: np.ndarray  # [3]

    @classmethod
    def from_grasp(cls, pose: BodyPose, glass: np.ndarray) -> "HeldGlass":
        """Return the glass that stands at `glass` `[3]` [m], held by a hand at `pose`."""
        return cls(pose.hand.T @ (glass - pose.grip), pose.hand[2])

    def stand_error(self, pose: BodyPose, centre: np.ndarray) -> np.ndarray:
        """Return residuals [m] from an upright glass with its middle at `centre` `[3]` [m]."""
        axis = pose.hand @ self.axis
        place = pose.grip + pose.hand @ self.centre
        return np.concatenate([place - centre, AXIS_WEIGHT * axis[:2]])

    def drink_error(self, pose: BodyPose, tilt: float) -> np.ndarray:
        """Return residuals [m] from a rim at the mouth, with the glass tilted by `tilt` [rad]."""
        axis = pose.hand @ self.axis
        rim = pose.grip + pose.hand @ self.centre + GLASS_HEIGHT / 2 * axis
        wanted = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
        return np.concatenate(
            [
                nearest_on_rim(rim, axis, pose.mouth) - pose.mouth,
                0.4 * AXIS_WEIGHT * (axis - wanted),
            ]
        )


def nearest_on_rim(rim: np.ndarray, axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the point of the rim's circle nearest to a point.

    Args:
        rim: The circle's centre `[3]` [m].
        axis: The glass's axis `[3]`, of length one.
        point: `[3]` [m].

    Returns:
        The nearest point `[3]` [m].
    """
    offset = point - rim
    radial = offset - (offset @ axis) * axis
    return rim + GLASS_RADIUS * radial / max(float(np.linalg.norm(radial)), 1e-9)
