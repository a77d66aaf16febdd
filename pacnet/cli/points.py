"""`pacnet fit --points`: which dimensions of a percept are points, and what is used of them."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pacnet.imitator.config import ImitatorConfig
    from pacnet.imitator.points import PointsChoice

_NONE = "none"  # in place of all points


def add_points(parser: argparse.ArgumentParser) -> None:
    """Add the option --points."""
    # Brackets in a metavar break the usage of older versions of argparse.
    parser.add_argument(
        "--points", nargs="+", metavar="POINT",
        help="after DATASET: which dimensions of a percept are points, each as "
        "NAME=FEATURE[FIRST:END], such as 'hand=observation.state[0:3]': first the one that the "
        "robot's actions move, then landmarks; with an orientation "
        "NAME=FEATURE[0:3]+FEATURE[3:7], a quaternion, w first, or FEATURE[3:7]:xyzw; an angle is "
        "FEATURE[2]; none for no points (found by the names of dimensions, "
        "such as hand.x, hand.y, hand.z)",
    )  # fmt: skip


def points_of(arguments: argparse.Namespace) -> PointsChoice:
    """Return the points that were asked for, as `Imitator.from_demonstrations` takes them."""
    if arguments.points is None:
        return "auto"
    return None if arguments.points == [_NONE] else arguments.points


def describe_points(config: ImitatorConfig) -> dict[str, Any]:
    """Return the points of an imitator, and why it has none, for JSON.

    Returns:
        `points`: name -> names of its dimensions, the moved one first; `no_points`: a reason, None
        if there are some.
    """
    from pacnet.imitator.points import find_points

    points, names = config.points or (), config.point_dimensions
    document = {point.name: [names[number] for number in point.used] for point in points}
    found, reason = find_points(config.percepts, config.state_features)
    if found is not None:
        reason = _unused(config, ", ".join(found.names))
    return {"points": document, "no_points": None if document else reason}


def _unused(config: ImitatorConfig, names: str) -> str:
    """Return why points that are found by their names are not used."""
    if config.targets == "state" or config.budget is not None:
        why = "targets are states" if config.targets == "state" else "there is a budget"
        return f"{why} (by their names there are {names})"
    return f"as asked, or since {names}, found by their names, do not hold"


def points_text(document: Mapping[str, Any]) -> str:
    """Return in words what `describe_points` returned."""
    if not document["points"]:
        return f"none: {document['no_points']}"
    moved, *landmarks = document["points"]
    return ", ".join([f"{moved} (moved)", *landmarks])
