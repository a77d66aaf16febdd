"""Chains of hinges, posed by SciPy's rotations one hinge after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pacnet.forward_models.kinematics import KinematicModel

Array = NDArray[np.float64]


class Chain(NamedTuple):
    """K hinges among J angles."""

    joints: tuple[str, ...]
    moving: tuple[int, ...]
    axes: Array  # [K, 3], of length one
    links: Array  # [K, 3] [m], from each hinge to the next, the last to the hand

    def pose(self, angles: Array) -> tuple[Array, Rotation]:
        """Return where the hand is and how it is turned, in a posture `[J]`."""
        place, turn = np.zeros(3), Rotation.identity()
        for joint, axis, link in zip(self.moving, self.axes, self.links, strict=True):
            turn = turn * Rotation.from_rotvec(angles[joint] * axis)
            place = place + turn.apply(link)
        return place, turn

    def poses(self, angles: Array) -> tuple[Array, Array]:
        """Return places `[N, 3]` and quaternions w, x, y, z `[N, 4]`."""
        poses = [self.pose(one) for one in angles]
        return np.array([place for place, _ in poses]), np.array([wxyz(turn) for _, turn in poses])


def wxyz(turn: Rotation) -> Array:
    return np.roll(turn.as_quat(), 1)  # the scalar is SciPy's last


def rotation(turn: Array) -> Rotation:
    return Rotation.from_quat(np.roll(turn, -1, axis=-1))


def make_chain(moving: int, joints: int, seed: int = 0) -> Chain:
    """Hinges about random axes, a random choice of the joints, and links of some 0.3 m."""
    rng = np.random.default_rng(seed)
    chosen = tuple(sorted(rng.choice(joints, moving, replace=False).tolist()))
    axes = rng.standard_normal((moving, 3))
    names = tuple(f"joint_{number}" for number in range(joints))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return Chain(names, chosen, axes, rng.normal(0, 0.2, (moving, 3)))


def postures(chain: Chain, count: int, seed: int, widest: float = 1.2) -> Array:
    return np.random.default_rng(seed).uniform(-widest, widest, (count, len(chain.joints)))


def exact_model(chain: Chain, widest: float = 1.2) -> KinematicModel:
    """Return the model of a chain, its angles within ± `widest` [rad]."""
    ends = np.full(len(chain.joints), widest)

    def function(angles: Array) -> tuple[Array, Array]:
        place, turn = chain.pose(angles)
        return place, turn.as_matrix()

    return KinematicModel.from_function(function, chain.joints, -ends, ends)
