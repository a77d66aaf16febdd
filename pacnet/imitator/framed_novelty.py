"""Novelty in frames of reference: what is out of all proportion to what was shown.

One demonstration is enough wherever the landmarks are, so their places are not novel. A landmark so
far from the moved point that nothing like it was shown is, and so is anything else that is outside
of the range shown.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.imitator.novelty import NoveltyScore
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.scene import WORLD, Scene, to_vector
from pacnet.schemas.segments import Segments

Array = NDArray[np.float64]

_FAR = 3.0  # times the largest distance of two points in what was shown
_BEYOND = 2.0  # of its range: how far outside of what was shown something else may be

_REACH = 0.05  # share of the scene's size by which a hand may miss a place
_TILTED = 0.6  # [rad] by which it may be turned otherwise than shown


class Bounds(NamedTuple):
    """What is known, in the percept's units and in shares of ranges."""

    farthest: float
    """Distance of a landmark from the moved point above which it is novel."""
    middle: Array
    """Of the range of what is no point, in shares of that range, `[Q]`."""
    half: Array
    """Half of that range, and how far beyond it something is known, `[Q]`."""


def bounds_of(segments: Segments) -> Bounds:
    """Return the bounds of what was shown."""
    places = segments.places
    apart = np.linalg.norm(places[:, None] - places[:, :, None], axis=3).max()
    low, high = segments.others.min(axis=0), segments.others.max(axis=0)
    return Bounds(_FAR * float(apart), (high + low) / 2, (high - low) / 2 + _BEYOND)


def score(places: Array, others: Array, bounds: Bounds, config: FramesConfig) -> NoveltyScore:
    """Score one percept.

    Args:
        places: of all points, `[P, 3]`.
        others: of what is no point, in shares of its range, `[Q]`.
        bounds: of what was shown.
        config: of the frames.

    Returns:
        Deviation and threshold in the percept's own units: of a landmark that is too far away, in
        the dimension where it is farthest.
    """
    far, most = 0, -1.0
    (x, y, z), *landmarks = places.tolist()
    for number, (u, v, w) in enumerate(landmarks):
        distance = math.sqrt((u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2)
        if distance > most:
            far, most = number, distance
    novelty = most / bounds.farthest if bounds.farthest > 0 else math.inf
    if len(others) > 0:
        away = others - bounds.middle
        ratio = np.abs(away) / bounds.half
        other = int(ratio.argmax())
        if ratio[other] > novelty:
            unit = config.ranges[other]
            deviation, limit = float(away[other] * unit), float(bounds.half[other] * unit)
            return NoveltyScore(float(ratio[other]), config.others[other], deviation, limit)
    apart = places[far + 1] - places[0]
    axis = int(np.abs(apart).argmax())
    dimension = config.points.landmarks[far].place[axis]
    return NoveltyScore(novelty, dimension, float(apart[axis]), bounds.farthest)


def unreached(miss: Array, landmark: int, turns: Array, config: FramesConfig) -> NoveltyScore:
    """Score what a body cannot reach of the way to a landmark.

    Args:
        miss: by how much the posture at its end is off: along three axes, and turned [rad], `[4]`.
        landmark: number of the landmark, `WORLD` for none.
        turns: how all points are turned, `[P, 4]`.
        config: of the frames.

    Returns:
        The distance from the place that can be reached, in the dimension where it is largest, or
        by how much the hand would be turned, in the landmark's own dimension that is turned most.
        Of a landmark whose orientation is not perceived only the place counts.
    """
    if landmark == WORLD:
        return NoveltyScore(0.0, 0, 0.0, 1.0)
    point, reach = config.points.landmarks[landmark], _REACH * config.size.extent
    axis = int(np.abs(miss[:3]).argmax())
    short = float(np.linalg.norm(miss[:3])) / reach
    turned = float(miss[3]) / _TILTED if point.orientation else 0.0
    if short >= turned:
        return NoveltyScore(short, point.place[axis], float(miss[axis]), reach)
    axis = int(np.abs(to_vector(turns[1 + landmark])).argmax())
    most = max(0, axis + len(point.orientation) - 3)  # a quaternion begins with w
    return NoveltyScore(turned, point.orientation[most], float(miss[3]), _TILTED)


def novelty_of(scene: Scene, others: Array, bounds: Bounds) -> Array:
    """Return the novelty of each of T percepts, as `score` gives it, `[T]`.

    Args:
        scene: of the percepts.
        others: of what is no point, in shares of its range, `[T, Q]`.
        bounds: of what was shown.
    """
    places = scene.places
    distances = np.linalg.norm(places[:, 1:] - places[:, :1], axis=2).max(axis=1)
    infinite = np.full(len(places), math.inf)
    novelty = distances / bounds.farthest if bounds.farthest > 0 else infinite
    if others.shape[1] == 0:
        return novelty
    return np.maximum(novelty, (np.abs(others - bounds.middle) / bounds.half).max(axis=1))
