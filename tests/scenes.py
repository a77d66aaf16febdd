"""Hand-made demonstrations of a hand and two landmarks, in metres unless said otherwise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HOME, CUP, PLATE = (0.0, 0.0, 0.3), (0.4, 0.1, 0.0), (0.1, 0.5, 0.05)
REACHING, GRASPING, CARRYING = 1.5, 0.25, 1.25  # [s]
GRASPED = REACHING + GRASPING  # [s] when the cup is set in motion
HELD = (0.0, 0.0, -0.03)  # of the cup from the hand that holds it


def path(stops: list[tuple[float, ...]], seconds: list[float], fps: float) -> Array:
    """Places `[T, 3]` of minimum jerk from each stop to the next, at rest at each."""
    parts = []
    for (begin, end), time in zip(pairwise(np.array(stops, float)), seconds, strict=True):
        share = np.arange(round(time * fps))[:, None] / round(time * fps)
        parts.append(begin + (10 * share**3 - 15 * share**4 + 6 * share**5) * (end - begin))
    return np.concatenate(parts)


def reaching(fps: float) -> Array:
    """Places `[T, 3, 3]` of a hand that goes to a cup and stays, the cup and a plate at rest."""
    grip = tuple(np.subtract(CUP, HELD))
    hand = path([HOME, grip, grip], [REACHING, GRASPING], fps)
    return _scene(hand, CUP, PLATE)


def carrying(fps: float) -> Array:
    """Places `[T, 3, 3]` of a hand that fetches the cup and brings it to the plate."""
    grip, end = tuple(np.subtract(CUP, HELD)), tuple(np.add(PLATE, (0.0, 0.0, 0.01)))
    hand = path([HOME, grip, grip, end], [REACHING, GRASPING, CARRYING], fps)
    places = _scene(hand, CUP, PLATE)
    held = np.arange(len(hand)) >= GRASPED * fps
    places[held, 1] = hand[held] + HELD
    return places


def noisy(places: Array, deviation: float, seed: int) -> Array:
    """The places with white noise."""
    return places + np.random.default_rng(seed).normal(0, deviation, places.shape)


def _scene(hand: Array, *landmarks: tuple[float, ...]) -> Array:
    still = [np.broadcast_to(landmark, hand.shape) for landmark in landmarks]
    return np.stack([hand, *still], axis=1)
