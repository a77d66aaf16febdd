"""The imitator's percepts of the demonstrator and its glass, and of itself and its own: 28 + 28."""

import numpy as np
from gymnasium.spaces import Box, Dict

from envs.humanoid import JOINTS
from envs.physics import SceneState

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


class Perception:
    """Draws noisy percepts of the scene, within an observation space.

    Args:
        joint_range: Of the 11 joints `[11, 2]` [rad].
        noise_scale: Factor on the noise.
    """

    def __init__(self, joint_range: np.ndarray, noise_scale: float) -> None:
        speed = np.full(len(JOINTS), MAX_VELOCITY)
        low = np.concatenate([joint_range[:, 0] - ANGLE_MARGIN, -speed]).astype(np.float32)
        high = np.concatenate([joint_range[:, 1] + ANGLE_MARGIN, speed]).astype(np.float32)
        far = np.repeat(np.array((MAX_DISTANCE, np.pi), dtype=np.float32), 3)
        body, glass = Box(low, high, dtype=np.float32), Box(-far, far, dtype=np.float32)
        self.space = Dict(
            {"demonstrator": body, "glass": glass, "proprioception": body, "own_glass": glass}
        )
        self._low = np.concatenate([low, -far, low, -far])  # [56]
        self._high = np.concatenate([high, far, high, far])  # [56]
        self._noise = noise_scale * noise_std()  # [56]

    def observe(
        self,
        state: SceneState,
        rng: np.random.Generator,
        own_rng: np.random.Generator,
        *,
        sees_demonstrator: bool = True,
        sees_own_glass: bool = True,
    ) -> dict[str, np.ndarray]:
        """Return percepts of the state, as float32 within the space.

        Args:
            state: Of the scene.
            rng: Of the noise, except that of the own glass.
            own_rng: Of the noise of the own glass.
            sees_demonstrator: Otherwise ``demonstrator`` is all zeros.
            sees_own_glass: Otherwise ``own_glass`` is all zeros.
        """
        truth = (
            state.angles[0],
            state.velocities[0],
            state.glass[0],
            tilt_vector(state.axis[0]),
            state.angles[1],
            state.velocities[1],
            state.glass[1],
            tilt_vector(state.axis[1]),
        )
        noisy = np.empty(56)
        rng.standard_normal(out=noisy[:50])
        own_rng.standard_normal(out=noisy[50:])
        noisy *= self._noise
        noisy += np.concatenate(truth)
        values = noisy.astype(np.float32)
        np.maximum(values, self._low, out=values)
        np.minimum(values, self._high, out=values)
        if not sees_demonstrator:
            values[:22] = 0.0
        if not sees_own_glass:
            values[50:] = 0.0
        return {
            "demonstrator": values[:22],
            "glass": values[22:28],
            "proprioception": values[28:50],
            "own_glass": values[50:],
        }


def noise_std() -> np.ndarray:
    """Return the standard deviations `[56]` of the observation's entries, in their order."""
    body = np.repeat((ANGLE_NOISE, VELOCITY_NOISE), len(JOINTS))
    return np.tile(np.concatenate([body, np.repeat((POSITION_NOISE, ANGLE_NOISE), 3)]), 2)


def tilt_vector(axis: np.ndarray) -> np.ndarray:
    """Return the shortest rotation vector `[3]` [rad] from the vertical to `axis` `[3]`."""
    x, y, z = axis.tolist()
    sine = abs(complex(x, y))  # equal to np.hypot, but six times faster
    angle = float(np.arctan2(sine, z))
    if sine < 1e-9:
        return np.array([angle, 0.0, 0.0])
    scale = angle / sine
    return np.array([scale * -y, scale * x, 0.0])
