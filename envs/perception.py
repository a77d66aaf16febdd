"""The imitator's percepts of the demonstrator and its glass, and of itself: 28 + 22 numbers."""

import numpy as np
from gymnasium.spaces import Box, Dict

from envs.humanoid import JOINTS

STATE_NAMES = tuple(f"{joint}.{kind}" for kind in ("pos", "vel") for joint in JOINTS)
GLASS_NAMES = ("glass.x", "glass.y", "glass.z", "glass.rx", "glass.ry", "glass.rz")

ANGLE_NOISE = 0.01  # [rad] std of perceived angles and of the glass's rotation vector
VELOCITY_NOISE = 0.05  # [rad/s] std of perceived velocities
POSITION_NOISE = 0.005  # [m] std of the glass's perceived position

ANGLE_MARGIN = 0.2  # [rad] by which a perceived angle may exceed the joint's range
MAX_VELOCITY = 30.0  # [rad/s]
MAX_DISTANCE = 2.0  # [m] of a perceived glass from the body, per axis


def percept(observation: dict[str, np.ndarray]) -> np.ndarray:
    """Return what the imitator's attention perceives: demonstrator and glass.

    Args:
        observation: Of this environment.

    Returns:
        Angles [rad], velocities [rad/s], the glass's position [m] and rotation [rad], `[28]`.
    """
    return np.concatenate([observation["demonstrator"], observation["glass"]])


def noise_std() -> np.ndarray:
    """Return the standard deviations `[50]` of the observation's entries, in their order."""
    own = np.repeat((ANGLE_NOISE, VELOCITY_NOISE), len(JOINTS))
    return np.concatenate([own, np.repeat((POSITION_NOISE, ANGLE_NOISE), 3), own])


def observation_space(joint_range: np.ndarray) -> tuple[Dict, np.ndarray, np.ndarray]:
    """Return the bounds of the percepts.

    Args:
        joint_range: Of the 11 joints `[11, 2]` [rad].

    Returns:
        The space, and all lower and all upper bounds `[50]` in the order of its entries.
    """
    speed = np.full(len(JOINTS), MAX_VELOCITY)
    low = np.concatenate([joint_range[:, 0] - ANGLE_MARGIN, -speed]).astype(np.float32)
    high = np.concatenate([joint_range[:, 1] + ANGLE_MARGIN, speed]).astype(np.float32)
    glass = np.repeat(np.array((MAX_DISTANCE, np.pi), dtype=np.float32), 3)
    space = Dict(
        {
            "demonstrator": Box(low, high, dtype=np.float32),
            "glass": Box(-glass, glass, dtype=np.float32),
            "proprioception": Box(low, high, dtype=np.float32),
        }
    )
    return space, np.concatenate([low, -glass, low]), np.concatenate([high, glass, high])


def tilt_vector(axis: np.ndarray) -> np.ndarray:
    """Return the shortest rotation vector `[3]` [rad] from the vertical to `axis` `[3]`."""
    x, y, z = axis.tolist()
    sine = abs(complex(x, y))  # equal to np.hypot, but six times faster
    angle = float(np.arctan2(sine, z))
    if sine < 1e-9:
        return np.array([angle, 0.0, 0.0])
    scale = angle / sine
    return np.array([scale * -y, scale * x, 0.0])
