"""Points of a percept, as a caller gives them: hand=observation.state[0:3]."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypeAlias

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.imitator.point_checks import check_points, those_that_hold
from pacnet.imitator.point_names import find_points, quaternion_order, unordered_quaternions
from pacnet.schemas.points import ORIENTATIONS, Point, Points

__all__ = [
    "PointsChoice",
    "check_points",
    "choose_points",
    "find_points",
    "parse_landmarks",
    "parse_moved",
    "parse_points",
    "usable_points",
]

PointsChoice: TypeAlias = Literal["auto"] | Sequence[str] | Mapping[str, str] | Points | None
"""Points as texts, or names and features; "auto" for those found by their names, None for none."""

Features: TypeAlias = Mapping[str, Sequence[str]]
"""Feature -> names of its dimensions, in the order of the percept."""

_FORM = "NAME=FEATURE[FIRST:END], such as hand=observation.state[0:3]"
_RANGE = re.compile(r"(?P<feature>[^\[\]]+)(?:\[(?P<first>\d{1,9})(?::(?P<end>\d{1,9}))?\])?")
_ORDER = re.compile(r"\s*:\s*(?P<order>xyzw|wxyz)$")


def choose_points(choice: PointsChoice, demonstrations: Demonstrations) -> Points | None:
    """Return the points to use, which hold in these demonstrations.

    Those that are found by their names are left out where they do not hold.

    Raises:
        ValueError: as `parse_points` and `check_points`, where points are given.
    """
    features, state = demonstrations.percept_features, demonstrations.state_features
    if choice is None:
        return None
    if isinstance(choice, str) and choice == "auto":
        found = find_points(features, state).points
        points = None if found is None else usable_points(found, demonstrations)
        if points is not None:
            _tell_of_quaternions(points, features)
        return points
    points = choice if isinstance(choice, Points) else parse_points(choice, features)
    check_points(points, demonstrations)
    return points


def parse_points(texts: Sequence[str] | Mapping[str, str], features: Features) -> Points:
    """Return the points that texts name; the first is what the robot's actions move.

    A text is NAME=FEATURE[FIRST:END], with END not included; NAME=FEATURE is all of a feature. An
    orientation stands behind a plus: `object=observation.pose[0:3]+observation.pose[3:7]`. Three
    dimensions of it are a rotation vector, one (`+FEATURE[3]`) an angle, four a quaternion: w comes
    first, unless the dimensions' names say otherwise, or the text: `+FEATURE[3:7]:xyzw`.

    Args:
        texts: one for each point, or name -> feature.
        features: feature -> names of its dimensions, in the order of the percept.

    Raises:
        ValueError: a text of another form, an unknown feature, a range out of it, a point that has
            neither two nor three dimensions or not those of the first, an orientation of another
            length, an order of what is no quaternion, the same name or dimension twice, or fewer
            than two points.
    """
    points = _parsed(texts, features)
    if len(points) < 2:
        raise ValueError(
            "expected the point that the robot's actions move, and a landmark at least, each as "
            f"{_FORM}, got {', '.join(point.name for point in points) or 'none'}"
        )
    return Points(points[0], tuple(points[1:]))


def parse_moved(texts: Sequence[str] | Mapping[str, str], features: Features) -> Point:
    """Return the first point that texts name, which the robot's actions move.

    Args:
        texts: as of `parse_points`; one is enough.
        features: feature -> names of its dimensions, in the order of the percept.

    Raises:
        ValueError: as `parse_points`; no point.
    """
    points = _parsed(texts, features)
    if not points:
        raise ValueError(f"expected the point that the robot's actions move, as {_FORM}, got none")
    return points[0]


def parse_landmarks(
    texts: Sequence[str] | Mapping[str, str], features: Features
) -> tuple[Point, ...]:
    """Return the landmarks that texts name, where a body says where the hand is.

    Args:
        texts: as of `parse_points`.
        features: feature -> names of its dimensions, in the order of the percept.

    Raises:
        ValueError: as `parse_points`; no landmark, or one in a plane.
    """
    landmarks = _parsed(texts, features)
    flat = [point.name for point in landmarks if len(point.place) < 3]
    if flat or not landmarks:
        raise ValueError(
            "expected landmarks of 3 dimensions beside a body's hand, such as "
            f"cup=observation.environment_state[0:3], got {', '.join(flat) or 'none'}"
        )
    return tuple(landmarks)


def _parsed(texts: Sequence[str] | Mapping[str, str], features: Features) -> list[Point]:
    pairs = [_named(text) for text in _as_texts(texts)]
    points = [_point(name, text, features) for name, text in pairs]
    if points:
        _check_together(points, features)
    return points


def usable_points(found: Points, demonstrations: Demonstrations) -> Points | None:
    """Return the points that hold in the demonstrations, and warn of the others; None for none."""
    points, problems = those_that_hold(found, demonstrations)
    for problem in problems:
        warnings.warn(
            f"by its name it is a point, but it is not used as one: {problem}",
            DatasetWarning,
            stacklevel=5,
        )
    return points


def _tell_of_quaternions(points: Points, features: Features) -> None:
    """Warn of orientations that are left out."""
    for name, turn in unordered_quaternions(features, points).items():
        warnings.warn(
            f"{turn!r} is not used as the orientation of {name!r}: name its dimensions w, x, y and "
            f"z, or say their order with --points {name}=...+{turn}:xyzw (points= in Python)",
            DatasetWarning,
            stacklevel=5,
        )


def _as_texts(texts: object) -> Iterable[object]:
    if isinstance(texts, Mapping):
        return [f"{name}={feature}" for name, feature in texts.items()]
    if isinstance(texts, str) or not isinstance(texts, Iterable):
        raise ValueError(f'expected points as a list of {_FORM}, "auto" or None, got {texts!r}')
    return texts


def _named(text: object) -> tuple[str, str]:
    """Return the name and the rest of a text."""
    name, equals, feature = text.partition("=") if isinstance(text, str) else ("", "", "")
    if not (name.strip() and equals and feature.strip()):
        raise ValueError(f"expected a point as {_FORM}, got {text!r}")
    return name.strip(), feature


def _point(name: str, text: str, features: Features) -> Point:
    """Return the point that a text without its name describes."""
    ordered = _ORDER.search(text)
    bare = text if ordered is None else text[: ordered.start()]
    parts = [_dimensions(name, part.strip(), features) for part in bare.split("+")]
    if len(parts) > 2:
        raise ValueError(f"expected {name!r} as a place + an orientation, got {text!r}")
    place, orientation = parts[0], parts[1] if len(parts) == 2 else ()
    if len(place) not in (2, 3):
        raise ValueError(f"expected {name!r} as 2 or 3 dimensions, got {len(place)}: {text!r}")
    turns = [*ORIENTATIONS] if len(place) == 3 else [0, 1]
    if len(orientation) not in turns:
        raise ValueError(
            f"expected the orientation of {name!r}, a point in {len(place)} dimensions, of "
            f"length {' or '.join(map(str, turns[1:]))}, got {len(orientation)}: {text!r}"
        )
    if len(orientation) == 4:
        names = ordered["order"] if ordered else [_names(features)[one] for one in orientation]
        orientation = tuple(orientation[number] for number in quaternion_order(names) or range(4))
    elif ordered is not None:
        raise ValueError(
            f"expected {ordered['order']} behind 4 dimensions of {name!r}, got {text!r}"
        )
    if {*place} & {*orientation}:
        raise ValueError(f"expected place and orientation of {name!r} apart, got {text!r}")
    return Point(name, place, orientation)


def _dimensions(name: str, text: str, features: Features) -> tuple[int, ...]:
    """Return the dimensions of the percept that FEATURE[FIRST:END], [NUMBER] or FEATURE is."""
    match = _RANGE.fullmatch(text)
    if match is None:
        raise ValueError(f"expected {name!r} as {_FORM}, got {text!r}")
    feature = match["feature"]
    if feature not in features:
        there = ", ".join(f"{one} [{len(names)}]" for one, names in features.items())
        raise ValueError(f"expected {name!r} to be of the features {there}, got {feature!r}")
    count = len(features[feature])
    first = int(match["first"] or 0)
    end = int(match["end"] or first + 1) if match["first"] else count
    if not first < end <= count:
        raise ValueError(
            f"expected {name!r} within the {count} dimensions {feature}[0:{count}], got {text!r}"
        )
    start = sum(len(features[one]) for one in [*features][: [*features].index(feature)])
    return tuple(range(start + first, start + end))


def _check_together(points: Sequence[Point], features: Features) -> None:
    """Raise a ValueError if points have the same name or dimension, or not as many dimensions."""
    first, seen = points[0], dict[int, str]()
    names = [point.name for point in points]
    for point in points:
        if names.count(point.name) > 1:
            raise ValueError(f"expected points of different names, got {point.name!r} twice")
        if len(point.place) != len(first.place):
            raise ValueError(
                f"expected {point.name!r} as {len(first.place)} dimensions, as {first.name!r}, "
                f"got {len(point.place)}"
            )
        for dimension in point.used:
            if dimension in seen:
                raise ValueError(
                    f"expected points of different dimensions, got {seen[dimension]!r} and "
                    f"{point.name!r} of {_names(features)[dimension]!r}"
                )
            seen[dimension] = point.name


def _names(features: Features) -> list[str]:
    """Return the name of each dimension of a percept; of unnamed ones, FEATURE[NUMBER]."""
    return [
        f"{feature}[{number}]" if name.isdecimal() else name
        for feature, names in features.items()
        for number, name in enumerate(names)
    ]
