"""What a model of a body has learned, as plain arrays, and the records that it answers with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor


class KinematicArrays(NamedTuple):
    """What compiled callers need of a `KinematicModel`; copies."""

    coefficients: NDArray[np.float64]
    """`[3**K, 12]`."""
    moving: NDArray[np.int64]
    """The joints that move the hand, `[K]`."""
    lowest: NDArray[np.float64]
    """Of the angles that were fitted, `[J]` [rad], as below."""
    highest: NDArray[np.float64]


class ReachWork(NamedTuple):
    """Memory of `reach` for K joints that move the hand, float64."""

    levels: NDArray[np.float64]
    """Sums over the products of the joints from some joint on, and their slopes, `[P, 1 + K, 12]`.

    The first row ends up with the hand's pose, and its slope in each joint.
    """
    error: NDArray[np.float64]
    """What is left of the place's way, and of the turn's as a weighted rotation vector, `[6]`."""
    slopes: NDArray[np.float64]
    """Of the error's six numbers in each joint, `[K, 6]`."""
    normal: NDArray[np.float64]
    """Products of the slopes, `[K, K]`."""
    factor: NDArray[np.float64]
    """Its Cholesky factor, damped, `[K, K]`."""
    gradient: NDArray[np.float64]
    """`[K]`."""
    free: NDArray[np.bool_]
    """Which joints are not at an end of their range that they would leave, `[K]`."""
    step: NDArray[np.float64]
    """[rad], `[K]`."""
    trial: NDArray[np.float64]
    """Posture, `[J]` [rad]."""


class HandPose(NamedTuple):
    """Where hands are, in the body's frame."""

    place: Tensor
    """In the unit that was fitted, `[..., 3]`."""
    turn: Tensor
    """Unit quaternions w, x, y, z with w ≥ 0, `[..., 4]`."""


class Reach(NamedTuple):
    """A posture that takes the hand to a place, or as near as it gets."""

    angles: NDArray[np.float64]
    """`[J]` [rad]."""
    distance: float
    """From the place, in the unit that was fitted."""
    turn: float
    """Angle from the turn wanted [rad]; 0 where none was."""


class KinematicFit(NamedTuple):
    """How a fit of a `KinematicModel` went; each posture is predicted from all others."""

    place_rms: float
    """Of the distance from where the hand was seen, in its unit."""
    turn_rms: float
    """Of the angle from how it was turned [rad]."""
    moving: tuple[str, ...]
    """Names of the joints that move the hand."""
