"""Whether points hold in demonstrations: one moves, the landmarks are there, and all differ."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.datasets.format.numbers import episodes_text, numbers_text
from pacnet.schemas.points import Points
from pacnet.vision.goals import SHARES, goal_name

_TOLD = tuple(map(goal_name, range(len(SHARES))))
"""Names of the landmarks that cameras tell."""
Places = Sequence[Tensor]
"""A point's place in each episode, `[T ≥ 1, 2 or 3]`."""


def check_points(points: Points, demonstrations: Demonstrations) -> None:
    """Raise a ValueError unless these points hold in the demonstrations.

    A landmark that is zero in all frames of all episodes may be at the world's origin: of that a
    `DatasetWarning` tells.

    Raises:
        ValueError: dimensions beyond the percept, a moved point that never moves, a landmark that
            is the same as another point in all frames, unless a camera tells it, or one that is
            zero in all frames of some episodes: it is not there.
    """
    problems, places = _problems(points, demonstrations), _places(points, demonstrations)
    at_origin = [
        name for name in problems if name in points.names[1:] and _is_padding(places[name])
    ]
    for name, problem in problems.items():
        if name not in at_origin:
            raise ValueError(problem)
    if len(at_origin) > 1:
        raise ValueError(
            f"expected landmarks at different places, got {', '.join(at_origin)} at zero in all "
            "frames"
        )
    for name in at_origin:
        warnings.warn(
            f"{name!r} is zero in all frames: it is taken to be at the origin; leave it out if it "
            "is padding",
            DatasetWarning,
            stacklevel=5,
        )


def those_that_hold(
    points: Points, demonstrations: Demonstrations
) -> tuple[Points | None, list[str]]:
    """Return the points that hold in the demonstrations, and what is wrong with the others.

    Nothing is said of padding, landmarks that are zero in all frames, unless no other is left.

    Returns:
        The points, None where nothing moves or no landmark is left; and a sentence for each other.

    Raises:
        ValueError: dimensions beyond the percept.
    """
    problems = _problems(points, demonstrations)
    if points.moved.name in problems:
        return None, [problems[points.moved.name]]
    kept = tuple(landmark for landmark in points.landmarks if landmark.name not in problems)
    if not kept:
        return None, [*problems.values()]
    places = _places(points, demonstrations)
    told = [text for name, text in problems.items() if not _is_padding(places[name])]
    return replace(points, landmarks=kept), told


def _problems(points: Points, demonstrations: Demonstrations) -> dict[str, str]:
    """Return what is wrong with points: name -> a sentence."""
    places = _places(points, demonstrations)
    numbers = [shown.episode for shown in demonstrations if len(shown.state)]
    moved = points.moved.name
    problems = {}
    if not any(bool((place != place[:1]).any()) for place in places[moved]):
        problems[moved] = (
            f"expected {moved!r} to be what the robot's actions move, it never moves in any episode"
        )
    known = {moved: places[moved]}
    for landmark in points.landmarks:
        name = landmark.name
        problem = _absence(name, places[name], numbers)
        if name not in _TOLD:  # who rests at the end has two goals in one place
            problem = problem or _sameness(name, places[name], known)
        if problem:
            problems[name] = problem
        else:
            known[name] = places[name]
    return problems


def _places(points: Points, demonstrations: Demonstrations) -> dict[str, Places]:
    """Return where each point is in each episode that has frames."""
    percepts = [shown.percepts for shown in demonstrations if len(shown.state)]
    for rows in percepts:
        if max(points.used) >= rows.shape[1]:
            raise ValueError(
                f"expected points within the {rows.shape[1]} dimensions of percepts, got "
                f"{max(points.used)}"
            )
    return {point.name: [rows[:, [*point.place]] for rows in percepts] for point in points}


def _is_zero(place: Tensor) -> bool:
    return not bool(place.any())


def _is_padding(places: Places) -> bool:
    return all(map(_is_zero, places))


def _absence(name: str, places: Places, episodes: Sequence[int]) -> str:
    """Return that a landmark is not there, if it is not in some episodes."""
    missing = {number for number, one in zip(episodes, places, strict=True) if _is_zero(one)}
    if _is_padding(places):
        return f"expected {name!r} to be a place, it is zero in all frames: padding is no landmark"
    if not missing:
        return ""
    return (
        f"expected {name!r} to be there in every episode, it is zero in all frames of "
        f"{episodes_text(missing)}: leave out what lacks it with --exclude {numbers_text(missing)} "
        f"(exclude= in Python), or do without {name!r}"
    )


def _sameness(name: str, places: Places, others: Mapping[str, Places]) -> str:
    """Return that a landmark is the same as another point, if it is in all frames."""
    for other, known in others.items():
        if all(map(torch.equal, places, known)):
            return (
                f"expected {name!r} to be another place than {other!r}, both are one in all frames"
            )
    return ""
