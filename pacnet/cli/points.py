"""`pacnet fit --points --body`: which dimensions of a percept are points, and a body's hand."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pacnet.cli.parsing import path
from pacnet.cli.printing import counted

if TYPE_CHECKING:
    from pacnet.forward_models.config import KinematicModelConfig
    from pacnet.forward_models.kinematics import KinematicModel
    from pacnet.imitator.config import ImitatorConfig
    from pacnet.imitator.points import PointsChoice

NONE = "none"  # in place of all points, or of a feature


def add_points(parser: argparse.ArgumentParser) -> None:
    """Add the options --points and --body."""
    # Brackets in a metavar break the usage of older versions of argparse.
    parser.add_argument(
        "--points", nargs="+", metavar="POINT",
        help="after DATASET: which dimensions of a percept are points, each as "
        "NAME=FEATURE[FIRST:END], such as 'hand=observation.state[0:3]': first the one that the "
        "robot's actions move, then landmarks; with an orientation "
        "NAME=FEATURE[0:3]+FEATURE[3:7], a quaternion, w first, or FEATURE[3:7]:xyzw; an angle is "
        "FEATURE[2]; none for no points (found by the names of dimensions, "
        "such as hand.x, hand.y, hand.z); with --body landmarks alone",
    )  # fmt: skip
    parser.add_argument(
        "--body", type=path, metavar="FOLDER",
        help="checkpoint of a KinematicModel, for percepts with joint angles instead of a hand: it "
        "tells where the hand is, and finds the angles that take it to a landmark; each joint is "
        "called NAME or NAME.pos in percepts and actions, and its action is the angle to go to "
        "[rad]",
    )  # fmt: skip


def points_of(arguments: argparse.Namespace) -> PointsChoice:
    """Return the points that were asked for, as `Imitator.from_demonstrations` takes them."""
    if arguments.points is None:
        return "auto"
    return None if arguments.points == [NONE] else arguments.points


def body_of(arguments: argparse.Namespace) -> KinematicModel | None:
    """Return the model of the body that was named, if one was.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: it is damaged, or of something else.
    """
    if arguments.body is None:
        return None
    from pacnet.forward_models.kinematics import KinematicModel

    return KinematicModel.from_pretrained(arguments.body)


def describe_body(config: ImitatorConfig) -> dict[str, list[str]] | None:
    """Return which joints an imitator's body has, as `describe_joints`; None without a body."""
    body = None if config.frames is None else config.frames.body
    return None if body is None else describe_joints(body.model)


def describe_joints(model: KinematicModelConfig) -> dict[str, list[str]]:
    """Return the names of a body's joints, and of those that move the hand, for JSON."""
    return {
        "joints": [*model.joints],
        "moving": [model.joints[number] for number in model.moving],
    }


def describe_points(config: ImitatorConfig) -> dict[str, Any]:
    """Return the points of an imitator, and why it has none, for JSON.

    Returns:
        `points`: name -> names of its dimensions, the moved one first; `no_points`: a reason, None
        if there are some; `body`: as of `describe_body`.
    """
    from pacnet.imitator.points import find_points

    points, names = config.points or (), config.point_dimensions
    document = {point.name: [names[number] for number in point.used] for point in points}
    found, reason = find_points(config.percepts, config.state_features)
    if found is not None:
        reason = _unused(config, ", ".join(found.names))
    return {
        "points": document,
        "no_points": None if document else reason,
        "body": describe_body(config),
    }


def _unused(config: ImitatorConfig, names: str) -> str:
    """Return why points that are found by their names are not used."""
    if config.targets == "state":
        return f"targets are states (by their names there are {names})"
    return f"as asked, or since {names}, found by their names, do not hold"


def points_text(document: Mapping[str, Any]) -> str:
    """Return in words what `describe_points` returned."""
    if not document["points"]:
        return f"none: {document['no_points']}"
    moved, *landmarks = document["points"]
    how = "moved" if document["body"] is None else "of the body"
    return ", ".join([f"{moved} ({how})", *landmarks])


def body_text(document: Mapping[str, Any]) -> str:
    """Return in words what `describe_joints` returned."""
    joints, moving = document["joints"], document["moving"]
    if len(moving) == len(joints):
        return f"the hand moves with all of its joints: {', '.join(joints)}"
    return f"{', '.join(moving)} move the hand, of {counted(len(joints), 'joint')}"
