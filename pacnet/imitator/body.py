"""Chooses settings of frames of reference for a robot whose body says where its hand is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch

from pacnet.attention.cutting import measure
from pacnet.datasets.demonstrations import Demonstrations, dimension_names
from pacnet.forward_models.config import KinematicModelConfig
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.frames import moving, others_of
from pacnet.imitator.point_checks import check_points
from pacnet.imitator.point_names import find_landmarks
from pacnet.imitator.points import PointsChoice, parse_landmarks, usable_points
from pacnet.imitator.put_back import find_put_back
from pacnet.schemas.body import BodyConfig
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.points import Point, Points
from pacnet.schemas.scene import scene_of
from pacnet.schemas.smoothing import choose_smoothing, smooth

Features = Mapping[str, tuple[str, ...]]

HAND = "hand"
_ANGLES = ("pos", "position", "angle", "q")  # ends of the names of angles
_APART = 0.5  # share of the spread of angles by which actions may be off them
_IMPLIED = "observation.implied"  # feature of what a percept implies
_NOISE = 0.1  # [rad], of an angle that was not moved
_STILL = (1.0, 1.0)  # smoothing of a place that is remembered: it is a mean


def choose_body_frames(
    body: KinematicModel,
    choice: PointsChoice,
    demonstrations: Demonstrations,
    scale: Sequence[float],
) -> FramesConfig:
    """Return settings for landmarks that are perceived, and a hand that the body tells of.

    Args:
        body: of the robot.
        choice: the landmarks, without the hand; see `pacnet.imitator.points`.
        demonstrations: continuous ones.
        scale: factor on each dimension of a percept, `[D]`.

    Raises:
        ValueError: no landmark; percepts or actions without an angle of each joint; angles that the
            body can't have; or landmarks that do not hold.
    """
    config = body_config(body, demonstrations)
    _check_targets(config, demonstrations)
    names, features = demonstrations.percept_features, demonstrations.state_features
    landmarks = landmarks_of(choice, names)
    first = len(dimension_names(names))
    hand = Point(HAND, tuple(range(first, first + 3)), tuple(range(first + 3, first + 7)))
    extended = _with_hands(body, config, demonstrations)
    points = _that_hold(Points(hand, landmarks), choice, extended)
    seen = [scene_of(one.percepts.numpy(), points) for one in extended]
    smoothing = choose_smoothing([scene.places for scene in seen])
    places = [smooth(scene.places, smoothing) for scene in seen]
    size = measure(moving([place[:, 0] for place in places]), demonstrations.fps)
    back = find_put_back(places, demonstrations, size)
    own = _own_dimensions(config, names, features)
    others, ranges = others_of(demonstrations, {*points.used, *own}, scale)
    return FramesConfig(
        _with_former_places(points, back, first + 7),
        size,
        (*smoothing, *[_STILL] * len(back)),
        others,
        ranges,
        None,
        config,
        back,
    )


def body_config(body: KinematicModel, demonstrations: Demonstrations) -> BodyConfig:
    """Return which dimensions of percepts and actions are the angles of a body, by their names.

    Raises:
        ValueError: no body, no angle of each of its joints, or angles that it can't have.
    """
    if not isinstance(body, KinematicModel):
        raise ValueError(f"expected a KinematicModel as the body, got {type(body).__name__}")
    names, joints = demonstrations.percept_features, body.config.joints
    config = named_angles(body.config, names, demonstrations.action_names)
    lowest, highest = body.lowest.numpy(), body.highest.numpy()
    reach = highest - lowest + _NOISE  # noise may exceed a range, degrees do so by far
    for shown in demonstrations:
        angles = shown.percepts[:, list(config.angles)].double().numpy()
        away = np.maximum(lowest - angles, angles - highest).max(axis=0) > reach
        if away.any():
            joint = int(away.argmax())
            raise ValueError(
                f"episode {shown.episode}: expected the angle {joints[joint]!r} of the body within "
                f"{lowest[joint]:.2f} to {highest[joint]:.2f} rad, got "
                f"{angles[:, joint].min():.2f} to {angles[:, joint].max():.2f}"
            )
    return config


def _check_targets(config: BodyConfig, demonstrations: Demonstrations) -> None:
    """Raise a ValueError unless actions are near the angles that are perceived: where to go."""
    angles = torch.cat([one.percepts for one in demonstrations])[:, list(config.angles)].double()
    actions = torch.cat([one.action for one in demonstrations])[:, list(config.commands)].double()
    spread = (angles - angles.mean(dim=0)).square().mean().sqrt().item()
    apart = (actions - angles).square().mean().sqrt().item()
    if apart > _APART * spread + _NOISE:
        raise ValueError(
            f"expected actions that are the angles to go to, got some {apart:.2f} rad from "
            f"the angles perceived, which spread by {spread:.2f} rad: actions that are changes of "
            "angles, or velocities, cannot be used with a body"
        )


def named_angles(
    model: KinematicModelConfig, features: Features, actions: Sequence[str]
) -> BodyConfig:
    """Return which dimensions are the angles of a body, by their names.

    Args:
        model: of the body.
        features: feature of a percept -> names of its dimensions, in the order of the percept.
        actions: names of the action's dimensions.

    Raises:
        ValueError: no angle of each of its joints among percepts or actions, or several of one.
    """
    percepts = _numbers(model.joints, dimension_names(features), "percepts")
    return BodyConfig(model, percepts, _numbers(model.joints, actions, "actions"))


def _numbers(joints: Sequence[str], names: Sequence[str], where: str) -> tuple[int, ...]:
    """Return the dimension that is the angle of each joint: NAME, or NAME.pos."""
    found = []
    for joint in joints:
        called = [joint, *(f"{joint}.{end}" for end in _ANGLES)]
        own = [number for number, name in enumerate(names) if name in called]
        if len(own) != 1:
            raise ValueError(
                f"expected {where} with an angle of each of the {len(joints)} joints of the body, "
                f"called NAME or NAME.pos: {', '.join(joints)}; got {len(own) or 'none'} of "
                f"{joint!r} among {', '.join(names)}"
            )
        found += own
    return tuple(found)


def landmarks_of(choice: PointsChoice, features: Features) -> tuple[Point, ...]:
    """Return the points that are perceived, where a body says where the hand is.

    Args:
        choice: the landmarks; see `pacnet.imitator.points`.
        features: feature of a percept -> names of its dimensions, in the order of the percept.

    Raises:
        ValueError: as `parse_landmarks`; none were found by their names, or one is called as the
            body's hand is.
    """
    if isinstance(choice, Points):
        raise ValueError("expected landmarks as texts with a body, got Points")
    if choice is None or choice == "auto":
        landmarks = find_landmarks(features)
        if choice is None or not landmarks:
            raise ValueError(
                "expected a landmark beside the body's hand, such as "
                "cup=observation.environment_state[0:3], got none"
            )
        return landmarks
    landmarks = parse_landmarks(choice, features)
    if HAND in [landmark.name for landmark in landmarks]:
        raise ValueError(f"expected landmarks alone beside a body, got {HAND!r}, which is its own")
    return landmarks


def _that_hold(points: Points, choice: PointsChoice, demonstrations: Demonstrations) -> Points:
    """Return points that hold in demonstrations with the hand; those that are given all do."""
    if choice != "auto":
        check_points(points, demonstrations)
        return points
    usable = usable_points(points, demonstrations)
    if usable is None:
        raise ValueError("expected a hand that moves, and a landmark that is there, got none")
    return usable


def _with_hands(
    body: KinematicModel, config: BodyConfig, demonstrations: Demonstrations
) -> Demonstrations:
    """Return demonstrations whose percepts end with where the hand is, place and turn."""
    episodes = []
    for shown in demonstrations:
        place, turn = body(shown.percepts[:, list(config.angles)].double())
        implied = torch.cat([place, turn], dim=1).float()
        encoded = implied if shown.encoded is None else torch.cat([shown.encoded, implied], dim=1)
        episodes.append(replace(shown, encoded=encoded))
    names = {**demonstrations.names, _IMPLIED: tuple("0123456")}
    return replace(demonstrations, names=names, episodes=tuple(episodes))


def _with_former_places(points: Points, back: Sequence[int], first: int) -> Points:
    """Return points with where the landmarks stood that are put back."""
    former = []
    for number in back:
        landmark = points.landmarks[number]
        place = tuple(range(first, first + len(landmark.place)))
        former.append(Point(f"{landmark.name}'s place", place))
        first += len(place)
    return replace(points, landmarks=(*points.landmarks, *former))


def _own_dimensions(
    config: BodyConfig, names: dict[str, tuple[str, ...]], state: Sequence[str]
) -> set[int]:
    """Return the dimensions of a percept that tell of the body's joints: angles, velocities."""
    joints, own = config.model.joints, {*config.angles}
    first = 0
    for feature, parts in names.items():
        for number, name in enumerate(parts, start=first):
            if feature in state and any(name.startswith(f"{joint}.") for joint in joints):
                own.add(number)
        first += len(parts)
    return own
