"""Points of a percept, found by the names of its dimensions: hand.x, hand.y, hand.z."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from pacnet.datasets.feature_choice import ENVIRONMENT_STATE, STATE
from pacnet.schemas.points import Point, Points

_SEPARATOR = re.compile(r"[._\s/-]+")
_AXES = ("x", "y", "z")
# Ends of names beside a place's, in the order in which the best is taken.
_ORIENTATIONS = (("qw", "qx", "qy", "qz"), ("rx", "ry", "rz"), ("yaw",), ("theta",), ("angle",))
_QUATERNION = ("w", "x", "y", "z")
_TILTS = {"roll", "pitch"}  # beside which a yaw alone does not say how something is turned
_PLACE = {"pos", "position", "xyz", "place", "location", "translation"}
_TURN = {"rot", "rotation", "orientation", "ori", "quat", "quaternion"}
_KIND = re.compile(rf"(?:^|[._\s/-]+)(?:{'|'.join(_PLACE | _TURN)})$", re.IGNORECASE)
# Words of what has an x, a y and a z, but is no place.
_OTHERS = _TURN | {
    "vel", "velocity", "speed", "twist", "acc", "accel", "acceleration", "omega", "gyro", "angular",
    "force", "torque", "wrench", "effort", "delta", "rel", "relative", "offset", "error", "axis",
    "angle", "rotvec", "euler", "rpy", "mag", "magnetometer", "to", "from",
}  # fmt: skip
# Words of features whose numbers are one for each part, not coordinates.
_PARTS = {"joint", "joints", "motor", "motors", "finger", "fingers", "wheel", "wheels", "servo"}
_HANDS = {
    "hand", "gripper", "ee", "eef", "effector", "endeffector", "tcp", "tool", "wrist", "pointer",
    "agent",
}  # fmt: skip
_AIMS = {"goal", "target", "desired", "command"}  # where a hand is to be is no hand
_NAMES = {STATE: "hand", ENVIRONMENT_STATE: "object"}  # of points that are a whole feature


class FoundPoints(NamedTuple):
    """The points that names say, or why they say none."""

    points: Points | None
    """None if nothing is known to be moved, or there is no landmark."""
    reason: str
    """Why there are none, in a few words; empty if there are some."""


class _Candidate(NamedTuple):
    feature: str
    point: Point


def find_points(
    features: Mapping[str, Sequence[str]], state_features: Sequence[str]
) -> FoundPoints:
    """Find points by the names of their dimensions.

    A point is NAME.x, NAME.y and, in space, NAME.z of one feature, also with an underscore, also x,
    y and z alone; or a whole feature NAME_pos, NAME_position or NAME_xyz of two or three unnamed
    dimensions. Its orientation is beside it: NAME.qw, .qx, .qy, .qz, or .rx, .ry, .rz (a rotation
    vector), or .yaw, .theta or .angle; NAME_quat.w, .x, .y, .z; or a feature NAME_quat beside
    NAME_pos, if its dimensions' names say in which order it is. The moved point is the only one of
    the robot's state, or the one called like a hand. All others of as many dimensions are
    landmarks.

    Args:
        features: feature -> names of its dimensions, in the order of the percept.
        state_features: the features that are the robot's state.
    """
    found = _renamed([*_candidates(features)])
    if not found:
        return FoundPoints(None, "no dimensions are called like coordinates, as hand.x, hand.y are")
    sizes = Counter(len(one.point.place) for one in found)
    own = [one.point for one in found if one.feature in state_features]
    moved, reason = _moved(own, [point for point in own if sizes[len(point.place)] > 1])
    if moved is None:
        return FoundPoints(None, reason)
    others = [one.point for one in found if one.point != moved]
    alike = tuple(point for point in others if len(point.place) == len(moved.place))
    return FoundPoints(Points(moved, alike), "")


def find_landmarks(features: Mapping[str, Sequence[str]]) -> tuple[Point, ...]:
    """Find the points in space by the names of their dimensions, as `find_points` does.

    What is called like a hand is none: it is where a body has it.

    Args:
        features: feature -> names of its dimensions, in the order of the percept.
    """
    found = _renamed([*_candidates(features)])
    points = (one.point for one in found)
    return tuple(point for point in points if len(point.place) == 3 and not _is_hand(point.name))


def unit_of(name: str) -> str:
    """Return the last part of a dimension's name, in lower case."""
    return _SEPARATOR.split(name.lower())[-1]


def quaternion_order(names: Sequence[str]) -> tuple[int, ...] | None:
    """Return which of four dimensions are w, x, y and z by their names; None if these don't say."""
    letters = [unit_of(name).removeprefix("q") for name in names]
    if sorted(letters) != sorted(_QUATERNION):
        return None
    return tuple(letters.index(letter) for letter in _QUATERNION)


def unordered_quaternions(features: Mapping[str, Sequence[str]], points: Points) -> dict[str, str]:
    """Return the quaternions that are left out since nothing says their order: point -> feature."""
    owners = [feature for feature, names in features.items() for _ in names]
    turns = {
        point.name: _quaternion_beside(owners[point.place[0]], features)
        for point in points
        if len(point.place) == 3 and not point.orientation
    }
    return {name: turn for name, turn in turns.items() if turn is not None}


def _quaternion_beside(feature: str, features: Mapping[str, Sequence[str]]) -> str | None:
    """Return the feature NAME_quat beside NAME_pos."""
    if unit_of(feature) not in _PLACE:
        return None
    name = _KIND.sub("", feature)
    for other, names in features.items():
        if _KIND.sub("", other) == name and unit_of(other) in _TURN and len(names) == 4:
            return other
    return None


def _moved(own: Sequence[Point], paired: Sequence[Point]) -> tuple[Point | None, str]:
    """Return the point that the robot moves, or why none is known.

    Args:
        own: points of the robot's state.
        paired: those of them that have as many dimensions as another point.
    """
    if not own:
        return None, "the robot's state has no point, such as hand.x, hand.y: no frames"
    if not paired:
        return None, f"{_listed(own)} alone: no landmark in as many dimensions"
    hands = paired if len(paired) == 1 else [point for point in paired if _is_hand(point.name)]
    if len(hands) == 1:
        return hands[0], ""
    return None, f"{_listed(hands or paired)}: say with --points which the robot's actions move"


def _listed(points: Sequence[Point]) -> str:
    return ", ".join(point.name for point in points)


def _is_hand(name: str) -> bool:
    words = _words(name)
    return bool(words & _HANDS) and not words & _AIMS


def _words(*names: str) -> set[str]:
    parts = (part for name in names for part in _SEPARATOR.split(name.lower()))
    return {part.rstrip("0123456789") for part in parts}


def _candidates(features: Mapping[str, Sequence[str]]) -> Iterator[_Candidate]:
    """Yield the points of each feature."""
    first = 0
    for feature, names in features.items():
        found = [*_named_points(feature, names, first), *_whole_point(feature, names, first)]
        for point in found:
            if len(found) == 1 and len(point.place) == 3 and not point.orientation:
                point = replace(point, orientation=_ordered_beside(feature, features))
            yield _Candidate(feature, point)
        first += len(names)


def _ordered_beside(feature: str, features: Mapping[str, Sequence[str]]) -> tuple[int, ...]:
    """Return the dimensions of the quaternion beside a place; () for none, or in unknown order."""
    turn = _quaternion_beside(feature, features)
    order = None if turn is None else quaternion_order(features[turn])
    if turn is None or order is None:
        return ()
    first = sum(len(features[one]) for one in [*features][: [*features].index(turn)])
    return tuple(first + number for number in order)


def _renamed(found: Sequence[_Candidate]) -> list[_Candidate]:
    """Return them with the feature's name in front where two have the same name.

    Two of one feature also get the number of their first dimension behind it.
    """
    same = Counter(one.point.name for one in found)
    twice = Counter((one.feature, one.point.name) for one in found)
    renamed = []
    for one in found:
        name = one.point.name
        if same[name] > 1:
            number = f".{one.point.place[0]}" if twice[one.feature, name] > 1 else ""
            one = one._replace(point=replace(one.point, name=f"{one.feature}.{name}{number}"))
        renamed.append(one)
    return renamed


def _named_points(feature: str, names: Sequence[str], first: int) -> Iterator[Point]:
    """Yield the points of named dimensions, such as hand.x, hand.y."""
    groups = dict[str, dict[str, int]]()
    for dimension, name in enumerate(names, start=first):
        unit = unit_of(name)
        stem = name[: len(name) - len(unit)].rstrip("._-/ ")
        if unit in _QUATERNION and unit_of(stem) in _TURN:
            unit = f"q{unit}"
        if unit not in _AXES or not _words(feature, stem) & _OTHERS:
            groups.setdefault(_KIND.sub("", stem).strip(), {}).setdefault(unit, dimension)
    for stem, units in groups.items():
        place = tuple(units[axis] for axis in _AXES if axis in units)
        if {"x", "y"} <= units.keys():
            yield Point(stem or _own_name(feature), place, _orientation(units, len(place)))


def _whole_point(feature: str, names: Sequence[str], first: int) -> Iterator[Point]:
    """Yield the point that a feature is, such as observation.hand_pos, if its parts are unnamed."""
    name, words = _own_name(feature), _words(feature, *names)
    is_place = unit_of(feature) in ("pos", "position", "xyz") and unit_of(name) not in _PLACE
    unnamed = all(unit_of(part).isdecimal() for part in names)
    if is_place and unnamed and len(names) in (2, 3) and not words & (_OTHERS | _PARTS):
        yield Point(name, tuple(range(first, first + len(names))))


def _own_name(feature: str) -> str:
    """Return what to call a point that is a whole feature."""
    name = re.sub(r"^observations?\.", "", feature)
    return _NAMES.get(feature) or _KIND.sub("", name).strip() or feature.strip() or "point"


def _orientation(units: Mapping[str, int], dimensions: int) -> tuple[int, ...]:
    """Return the dimensions that say which way a point is turned; () for none."""
    for ends in _ORIENTATIONS:
        whole = all(end in units for end in ends) and (dimensions == 3 or len(ends) == 1)
        if whole and not (ends == ("yaw",) and _TILTS & units.keys()):
            return tuple(units[end] for end in ends)
    return ()
