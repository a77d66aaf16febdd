"""Chooses what cameras are to tell an imitator: where its hand will be, or a posture."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.body import body_config
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.points import PointsChoice, find_points, parse_moved
from pacnet.imitator.postures import see_postures
from pacnet.schemas.points import Point, Points
from pacnet.vision.cameras import Cameras
from pacnet.vision.cameras_config import CAMERAS
from pacnet.vision.config import NONE
from pacnet.vision.fitting import CameraReport, fit_cameras
from pacnet.vision.goals import SHARES, goal_name, goal_names

Hands = list[NDArray[np.floating]]
Settings = Callable[[Demonstrations, PointsChoice, Cameras | None], ImitatorConfig]
"""Chooses those of an imitator, from demonstrations with what cameras tell, points and cameras."""

_AXES = ("x", "y", "z")


class Seeing(NamedTuple):
    """Which cameras are used, and how."""

    config: ImitatorConfig
    """Of the imitator."""
    cameras: Cameras | None
    """None where no camera helps."""
    reports: tuple[CameraReport, ...]
    """Of all cameras."""


def see(
    demonstrations: Demonstrations,
    points: PointsChoice,
    body: KinematicModel | None,
    encoder: str,
    settings: Settings,
) -> Seeing:
    """Fit cameras to the pictures of demonstrations, if they have any, and choose settings.

    Where the hand is known, cameras tell places, which are landmarks. Where it is not, or actions
    do not move it, they tell postures.

    Args:
        demonstrations: whole episodes.
        points: as of `Imitator.from_demonstrations`; with cameras, the hand alone is enough.
        body: says where the hand is; None without one.
        encoder: what looks at the pictures; see `fit_cameras`.
        settings: chooses those of the imitator.

    Raises:
        ValueError: an unknown encoder; points that are none here; as `settings`.
    """
    has_pictures = any(shown.pictures for shown in demonstrations)
    moved = _moved(points, demonstrations) if has_pictures and body is None else None
    if has_pictures and (body is not None or moved is not None):
        seeing = _see_places(demonstrations, points, body, moved, encoder, settings)
        if seeing.cameras is None or seeing.config.frames is not None:
            return seeing
        points = None
    config = settings(demonstrations, points, None)
    if not has_pictures or config.frames is not None or encoder == NONE:
        return Seeing(config, None, ())
    cameras, reports = see_postures(demonstrations, config, encoder)
    config = replace(config, cameras=None if cameras is None else cameras.config)
    return Seeing(config, cameras, reports)


def _see_places(
    demonstrations: Demonstrations,
    points: PointsChoice,
    body: KinematicModel | None,
    moved: Point | None,
    encoder: str,
    settings: Settings,
) -> Seeing:
    """Fit cameras that tell where the hand, a body's or the point that is moved, will be."""
    names = _AXES if moved is None else _AXES[: len(moved.place)]
    place = () if moved is None else moved.place
    hands = hands_of(demonstrations, place, body)
    cameras, reports = fit_cameras(demonstrations, hands, names, encoder)
    if cameras is None:
        points = _without_goals(points, moved)
        return Seeing(settings(demonstrations, points, None), None, reports)
    seen = cameras.with_goals(demonstrations, hands)
    config = settings(seen, _with_goals(points, len(names)), cameras)
    return Seeing(config, cameras, reports)


def hands_of(
    demonstrations: Demonstrations, place: Sequence[int], body: KinematicModel | None
) -> Hands:
    """Return where the hand is in each frame of demonstrations, `[T, S]`.

    Args:
        demonstrations: some.
        place: the dimensions of a percept that say so; any with a body.
        body: says so from the angles; None without one.
    """
    if body is None:
        return [shown.percepts[:, [*place]].numpy() for shown in demonstrations]
    angles = [*body_config(body, demonstrations).angles]
    return [body(shown.percepts[:, angles].double())[0].float().numpy() for shown in demonstrations]


def place_of_hand(config: ImitatorConfig) -> tuple[int, ...]:
    """Return the dimensions of a percept that say where the hand is; none with a body."""
    frames = config.frames
    return () if frames is None or frames.body is not None else frames.points.moved.place


def _moved(points: PointsChoice, demonstrations: Demonstrations) -> Point | None:
    """Return the point that the robot's actions move; None where nothing says so."""
    features, state = demonstrations.percept_features, demonstrations.state_features
    if isinstance(points, Points):
        return points.moved
    if points is None:
        return None
    if points != "auto":
        return parse_moved(points, features)
    for size in (3, 2):
        found = find_points({**features, CAMERAS: goal_names(_AXES[:size])}, state).points
        if found is not None and len(found.moved.place) == size:
            return found.moved
    return None


def _with_goals(points: PointsChoice, size: int) -> PointsChoice:
    """Return points with the goals, of so many dimensions, among the landmarks."""
    if points is None or isinstance(points, str):
        return points  # they are found by their names
    if isinstance(points, Points):
        raise ValueError("expected points as texts with cameras, got Points")
    texts = (
        [f"{name}={feature}" for name, feature in points.items()]
        if isinstance(points, Mapping)
        else [*points]
    )
    goals = range(len(SHARES))
    return texts + [f"{goal_name(n)}={CAMERAS}[{n * size}:{(n + 1) * size}]" for n in goals]


def _without_goals(points: PointsChoice, moved: Point | None) -> PointsChoice:
    """Return points where no camera tells; a hand alone is none then."""
    if moved is None or points is None or isinstance(points, str | Points) or len(points) > 1:
        return points
    warnings.warn(
        f"{moved.name!r} has no landmark, and no camera tells where it will be: only what is done "
        "at the same place can be learned",
        DatasetWarning,
        stacklevel=5,
    )
    return None
