"""Where the points of a percept are and how they are turned, in three dimensions.

Places of two dimensions have a third of 0, and angles are turns about the third axis, so that all
that follows is written once. Turns are unit quaternions in the order w, x, y, z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.points import Point, Points

Array = NDArray[np.float64]

_UNTURNED = (1.0, 0.0, 0.0, 0.0)
WORLD = -1  # in place of a landmark: the percepts' own axes


class Scene(NamedTuple):
    """The P points of T percepts: the moved one first, then the landmarks."""

    places: Array
    """`[T, P, 3]`, in the percept's unit."""
    turns: Array
    """Unit quaternions, `[T, P, 4]`; 1, 0, 0, 0 of a point without an orientation."""


def scene_of(percepts: NDArray[np.floating], points: Points) -> Scene:
    """Return where the points of percepts `[T, D]` are, in the percept's own units."""
    values = percepts.astype(np.float64)
    places = np.zeros((len(values), len(points.names), 3))
    for number, point in enumerate(points):
        places[:, number, : len(point.place)] = values[:, point.place]
    return Scene(places, np.stack([_turn(values, point) for point in points], axis=1))


def _turn(values: Array, point: Point) -> Array:
    """Return how a point is turned, `[T, 4]`."""
    given = values[:, point.orientation]
    if len(point.orientation) == 4:
        length = np.linalg.norm(given, axis=1, keepdims=True)
        none = length < 1e-6  # there is no orientation in such a percept
        return np.where(none, (1.0, 0.0, 0.0, 0.0), given / np.where(none, 1.0, length))
    vector = np.zeros((len(values), 3))
    vector[:, 3 - given.shape[1] :] = given  # an angle is about the last axis
    return from_vector(vector)


def scene_at(percept: NDArray[np.floating], points: Points) -> tuple[Array, Array]:
    """Return places `[P, 3]` and turns `[P, 4]` of one percept `[D]`, as `scene_of`, but sooner."""
    values = percept.tolist()
    places = np.zeros((len(points.landmarks) + 1, 3))
    turns = []
    for number, point in enumerate(points):
        for axis, dimension in enumerate(point.place):
            places[number, axis] = values[dimension]
        turns.append(_turn_at([values[dimension] for dimension in point.orientation]))
    return places, np.array(turns)


def _turn_at(given: Sequence[float]) -> Sequence[float]:
    """Return how a point is turned, a quaternion."""
    if len(given) == 4:
        length = math.sqrt(math.fsum(one * one for one in given))
        return [one / length for one in given] if length >= 1e-6 else _UNTURNED
    if not given:
        return _UNTURNED
    angle = math.sqrt(math.fsum(one * one for one in given))
    factor = math.sin(angle / 2) / angle if angle > 1e-12 else 0.5
    vector = [factor * one for one in given]
    return [math.cos(angle / 2), *[0.0] * (3 - len(given)), *vector]


def from_vector(vector: Array) -> Array:
    """Return the quaternions `[..., 4]` of rotation vectors `[..., 3]` [rad]."""
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), np.sinc(angle / 2 / np.pi) / 2 * vector], axis=-1)


def to_vector(turn: Array) -> Array:
    """Return the rotation vectors `[..., 3]` [rad], to half a turn, of quaternions `[..., 4]`."""
    turn = np.where(turn[..., :1] < 0, -turn, turn)
    sine = np.linalg.norm(turn[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, turn[..., :1])
    return turn[..., 1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)


def multiply(first: Array, second: Array) -> Array:
    """Return the quaternions of turning by `second`, then by `first`, `[..., 4]`."""
    w, v = first[..., :1], first[..., 1:]
    x, u = second[..., :1], second[..., 1:]
    scalar = w * x - (v * u).sum(axis=-1, keepdims=True)
    return np.concatenate([scalar, w * u + x * v + np.cross(v, u)], axis=-1)


def conjugate(turn: Array) -> Array:
    """Return the inverse turns `[..., 4]`."""
    return turn * (1.0, -1.0, -1.0, -1.0)


def rotate(turn: Array, vector: Array) -> Array:
    """Return vectors `[..., 3]` turned by quaternions `[..., 4]`."""
    w, v = turn[..., :1], turn[..., 1:]
    twice = 2 * np.cross(v, vector)
    return vector + w * twice + np.cross(v, twice)


def landmark_of(scene: Scene, landmark: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return where a landmark is and how it is turned in each row, `[R, 3]` and `[R, 4]`."""
    rows, point = np.arange(len(landmark)), landmark + 1  # the moved point is the first
    world = (landmark == WORLD)[:, None]
    origin = np.where(world, 0.0, scene.places[rows, point])
    return origin, np.where(world, (1.0, 0.0, 0.0, 0.0), scene.turns[rows, point])


def pose_dimensions(point: Point) -> tuple[int, ...]:
    """Return which of a pose's six dimensions a point has: its place, then a rotation vector."""
    places = tuple(range(len(point.place)))
    turns = {0: (), 1: (5,)}.get(len(point.orientation), (3, 4, 5))
    return places + turns


def poses_of(scene: Scene, point: Point) -> Array:
    """Return the pose of the moved point, `[T, S]`, whose changes are those of a linear model.

    Turns are added up from frame to frame, so that they never jump.
    """
    places, turns = scene.places[:, 0], scene.turns[:, 0]
    first = to_vector(turns[:1])
    changes = to_vector(multiply(turns[1:], conjugate(turns[:-1])))
    vectors = np.concatenate([first, changes]).cumsum(axis=0)
    return np.concatenate([places, vectors], axis=1)[:, pose_dimensions(point)]
