"""Postures at which a given model of a body is asked where the hand is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.forward_models.config import MAX_MOVING
from pacnet.forward_models.kinematic_checks import Postures, check_array, check_turns
from pacnet.forward_models.kinematics_fit import least_postures
from pacnet.forward_models.turn_matrices import nearest_turns

Array = NDArray[np.float64]
Function = Callable[[Array], tuple[Any, Any]]

_PROBES = 8  # postures in which each joint is moved alone
_UNIT = 1e-3  # by which the product of a rotation matrix with its transpose may be off
_SAME = 1e-9  # of the largest change of a number


def postures_of(
    function: Function, joints: Sequence[str], low: Array, high: Array, rng: np.random.Generator
) -> tuple[tuple[int, ...], Postures]:
    """Return which joints move the hand, and enough postures with where the hand is in each.

    Args:
        function: see `KinematicModel.from_function`.
        joints: names, for the message.
        low: of each angle, `[J]` [rad].
        high: of each angle, `[J]` [rad].
        rng: of the postures.

    Raises:
        ValueError: no such function, or no or too many joints move the hand.
    """
    change = np.zeros(len(low))
    for _ in range(_PROBES):
        posture = rng.uniform(low, high)
        here = np.concatenate(_call(function, posture))
        for joint in range(len(low)):
            moved = posture.copy()
            moved[joint] = rng.uniform(low[joint], high[joint])
            change[joint] += np.abs(np.concatenate(_call(function, moved)) - here).max()
    moving = tuple(int(joint) for joint in np.flatnonzero(change > _SAME * max(1, change.max())))
    if not 1 <= len(moving) <= MAX_MOVING:
        names = [joints[joint] for joint in moving]
        raise ValueError(
            f"expected 1 to {MAX_MOVING} angles that move the hand, got {names or 'none'}"
        )
    angles = rng.uniform(low, high, (least_postures(len(low), len(moving)), len(low)))
    places, turns = map(np.array, zip(*(_call(function, one) for one in angles), strict=True))
    return moving, Postures(angles, places, turns)


def _call(function: Function, angles: Array) -> tuple[Array, Array]:
    """Return the place `[3]` and the quaternion `[4]` that a function gives."""
    pose = function(angles.copy())
    if not isinstance(pose, tuple | list) or len(pose) != 2:
        raise ValueError(f"expected a function that gives a place and a turn, got {pose!r}")
    place = check_array("the function's place", pose[0], (3,))
    if np.ndim(pose[1]) == 1:
        return place, check_turns(pose[1], (4,))
    matrix = check_array("the function's turn", pose[1], (3, 3))
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > _UNIT or np.linalg.det(matrix) < 0:
        raise ValueError(f"expected a rotation matrix, got {matrix.tolist()}")
    return place, nearest_turns(torch.from_numpy(matrix)).numpy()
