"""What a hand carries in each segment, and how it holds that.

What is carried is what has to be somewhere, whatever the hand is like that holds it: a glass that
was taken with a tilted hand is held upright all the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.scene import Scene, conjugate, multiply, rotate, to_vector

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_MOST = 0.5  # share of a segment's frames in which a landmark is carried that it is about
_LOOSE = 0.1  # [rad] by which what is held turns in the hand, if its turns are known at all
_FIRM = 0.5  # share of that by which its axis may turn, if only turns about it are not known


class Held(NamedTuple):
    """What is carried in each of S segments; nothing where `moved` is 0."""

    moved: Numbers
    """Number of the landmark + 1, `[S]`."""
    place: Array
    """In the hand, `[S, 3]`."""
    turn: Array
    """Relative to the hand, `[S, 4]`; 1, 0, 0, 0 where it is not perceived."""
    about_axis: NDArray[np.bool_]
    """Whether only its third axis keeps still in the hand, `[S]`: an object whose turns about
    itself are not perceived."""


def held_in(
    scene: Scene, carried: NDArray[np.bool_], first: Numbers, end: Numbers, config: FramesConfig
) -> Held:
    """Return what is carried in each segment, and how it is held on average.

    Args:
        scene: of all rows.
        carried: whether each landmark moves, `[R, M]`.
        first: the first row of each segment, `[S]`.
        end: the row after its last one, `[S]`.
        config: of frames; without a body nothing is held. What is carried turns as the hand does
            if its orientation is not perceived.
    """
    count = len(first)
    turn = np.zeros((count, 4))
    turn[:, 0] = 1.0
    held = Held(np.zeros(count, np.int64), np.zeros((count, 3)), turn, np.zeros(count, bool))
    if config.body is None:
        return held
    shares = np.add.reduceat(carried, first) / (end - first)[:, None]
    for one in np.flatnonzero(shares.max(axis=1) > _MOST):
        number = int(shares[one].argmax())
        rows = first[one] + np.flatnonzero(carried[first[one] : end[one], number])
        back = conjugate(scene.turns[rows, 0])
        apart = scene.places[rows, 1 + number] - scene.places[rows, 0]
        held.moved[one] = 1 + number
        held.place[one] = rotate(back, apart).mean(axis=0)
        if not config.points.landmarks[number].orientation:
            continue
        turns = multiply(back, scene.turns[rows, 1 + number])
        held.turn[one] = mean_turn(turns)
        held.about_axis[one] = _turns_about_axis(turns, held.turn[one])
    return held


def mean_turn(turns: Array) -> Array:
    """Return the mean of quaternions `[N, 4]`, `[4]`.

    It is the largest eigenvector of the sum of their outer products (Markley et al., 2007).
    """
    return np.linalg.eigh(turns.T @ turns)[1][:, -1]


def _turns_about_axis(turns: Array, mean: Array) -> bool:
    """Return whether turns `[N, 4]` differ from their mean, but hardly in how the axis points."""
    differences = to_vector(multiply(turns, conjugate(mean)))
    axis = rotate(turns, np.array([0.0, 0.0, 1.0]))
    usual = rotate(mean, np.array([0.0, 0.0, 1.0]))
    tilts = np.arctan2(np.linalg.norm(np.cross(axis, usual), axis=1), axis @ usual)
    turned = float(np.sqrt(np.square(differences).sum(axis=1).mean()))
    tilted = float(np.sqrt(np.square(tilts).mean()))
    return turned > _LOOSE and tilted < _FIRM * turned
