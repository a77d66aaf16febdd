"""Forward kinematics of one body, and inverse kinematics of its right arm by bounded least squares.

Positions are in the body frame (origin at the pelvis, x forwards, y to the left, z up).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from mujoco import MjData, MjModel, mj_kinematics  # pyright: ignore[reportAttributeAccessIssue]
from scipy.optimize import least_squares

from envs import humanoid
from envs.humanoid import JOINTS

RIGHT_ARM = tuple(i for i, name in enumerate(JOINTS) if name.startswith("right"))
POSTURE_WEIGHT = 0.01  # [m/rad] pull towards the start posture, for the redundant joints


class BodyPose(NamedTuple):
    """Points of a body in a posture."""

    wrist: np.ndarray  # [3] [m]
    grip: np.ndarray  # [3] [m]
    mouth: np.ndarray  # [3] [m]
    hand: np.ndarray  # [3, 3] rotation of the right hand


class BodyKinematics:
    """One humanoid without a scene, posed by its 11 joint angles."""

    def __init__(self) -> None:
        """Compile the body."""
        body = humanoid.build_humanoid("body", (0, 0, 0, 1), (0, 0, 0, 1))
        body.compiler.fusestatic = True
        self._model = MjModel.from_xml_string(body.to_xml_string())
        self._data = MjData(self._model)
        joints = [self._model.joint(name) for name in JOINTS]
        self._address = np.array([joint.qposadr[0] for joint in joints])
        self._sites = [self._model.site(name).id for name in ("wrist", "grip", "mouth")]
        self.joint_range = np.array([joint.range for joint in joints])  # [11, 2] [rad]

    def pose(self, angles: np.ndarray) -> BodyPose:
        """Return the body's points in a posture.

        Args:
            angles: Joint angles `[11]` [rad].

        Returns:
            Positions [m] and the hand's rotation, as copies.
        """
        self._data.qpos[self._address] = angles
        mj_kinematics(self._model, self._data)
        wrist, grip, mouth = self._data.site_xpos[self._sites]
        return BodyPose(
            wrist, grip, mouth, self._data.site_xmat[self._sites[1]].reshape(3, 3).copy()
        )

    def solve(self, start: np.ndarray, error: Callable[[BodyPose], np.ndarray]) -> np.ndarray:
        """Return right-arm angles that minimise `error`; the other joints stay as they are.

        Args:
            start: Posture to begin at `[11]` [rad].
            error: Residuals [m] of a pose; angles are weighted by a length.

        Returns:
            The posture `[11]` [rad], within the joint ranges.
        """
        arm = list(RIGHT_ARM)
        low, high = self.joint_range[arm].T
        first = np.clip(start[arm], low + 1e-6, high - 1e-6)
        posture = np.array(start, dtype=np.float64)

        def residuals(angles: np.ndarray) -> np.ndarray:
            posture[arm] = angles
            return np.append(error(self.pose(posture)), POSTURE_WEIGHT * (angles - first))

        posture[arm] = least_squares(residuals, first, bounds=(low, high), ftol=1e-4, xtol=1e-4).x
        return posture
