"""Which segment of a demonstration is followed, and where the moved point is in its frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.imitator.cuts import WORLD_NAME, ShownSegment
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import ImitatorStep
from pacnet.schemas.points import Points
from pacnet.schemas.scene import WORLD, conjugate, landmark_of, multiply, rotate


class _Seen(NamedTuple):
    """The moved point of one percept, and the landmark in whose frame it is seen."""

    place: NDArray[np.float64]  # [3]
    origin: NDArray[np.float64]  # [3]
    axes: NDArray[np.float64]  # [4]


def followed_segment(imitator: Imitator, step: ImitatorStep) -> dict[str, Any] | None:
    """Return the segment that the last step of an episode follows; None without points.

    Returns:
        Its `number` in the demonstration, from 1, `of` how many; the `landmark` that it is on the
        way to, and in whose frame its targets are kept (`reference`); how far the moved point
        (`moved`) is from there, and was at the moment followed, None where that is the world; and
        whether a body finds the angles that take it there (`of_body`).
    """
    points = imitator.config.points
    if points is None or step.segment is None or not step.followed:
        return None
    segments = imitator.cuts[step.followed[0].demonstration].segments
    segment = segments[step.segment]
    now, then = _seen(imitator, segment, points)
    in_world = segment.reference == WORLD_NAME
    return {
        "number": step.segment + 1,
        "of": len(segments),
        "landmark": segment.landmark,
        "reference": segment.reference,
        "moved": points.moved.name,
        "of_body": imitator.frames is not None and imitator.frames.body is not None,
        "distance": None if in_world else _distance(now),
        "distance_shown": None if in_world else _distance(then),
    }


def moved_deviation(imitator: Imitator, step: ImitatorStep) -> dict[str, Any]:
    """Return how far the moved point is off from where it was at the moment followed.

    It is compared in the frame of the segment's landmark.

    Returns:
        `dimension`, the one in which it is off most, and the signed `deviation` in its own unit;
        nothing without points.
    """
    points = imitator.config.points
    if points is None or step.segment is None:
        return {}
    segment = imitator.cuts[step.followed[0].demonstration].segments[step.segment]
    now, then = _seen(imitator, segment, points)
    turn = multiply(now.axes, conjugate(then.axes))
    apart = now.place - (now.origin + rotate(turn, then.place - then.origin))
    most = int(np.abs(apart[: points.dimensions]).argmax())
    names = (
        *imitator.percept_names,
        *(() if imitator.frames is None else imitator.frames.config.added),
    )
    name = names[points.moved.place[most]]
    return {"dimension": name, "deviation": float(apart[most])}


def _seen(imitator: Imitator, segment: ShownSegment, points: Points) -> tuple[_Seen, _Seen]:
    """Return the moved point now, and at the moment followed."""
    scene = imitator.followed_scene()
    names = [landmark.name for landmark in points.landmarks]
    number = WORLD if segment.reference == WORLD_NAME else names.index(segment.reference)
    origin, axes = landmark_of(scene, np.full(2, number))
    now, then = map(_Seen, scene.places[:, 0], origin, axes)
    return now, then


def _distance(seen: _Seen) -> float:
    return float(np.linalg.norm(seen.place - seen.origin))
