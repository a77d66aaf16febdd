"""`pacnet fit --cameras --encoder`: which cameras are looked at, and what each of them tells."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pacnet.cli.points import NONE

if TYPE_CHECKING:
    from pacnet.datasets.demonstrations import Demonstrations
    from pacnet.datasets.pictures.camera_choice import CameraChoice
    from pacnet.imitator.imitator import Imitator
    from pacnet.vision.config import Told

_ENOUGH = 5  # demonstrations, from which on a camera can be judged
_NOTHING_TOLD = (
    "not used: neither is the hand known, nor are actions places of the robot's state; name it "
    "with --points 'hand=FEATURE[FIRST:END]', or a body with --body"
)


def add_cameras(parser: argparse.ArgumentParser) -> None:
    """Add the options --cameras and --encoder."""
    parser.add_argument(
        "--cameras", nargs="+", metavar="NAME",
        help="after DATASET: cameras that are looked at, as in observation.images.top or top; none "
        "for none (all whose pictures can be decoded; those that do not help are not used). From "
        "five demonstrations on they may tell where the hand will be: --points, --body or names "
        "such as hand.x say where it is. It takes pip install 'pacnet[cameras]'",
    )  # fmt: skip
    parser.add_argument(
        "--encoder", metavar="KIND",
        help="what looks at pictures: patches, pca (eigenimages) or none; or a network with "
        "weights: torchvision:NAME, timm:NAME, hf:NAME or file:PATH (auto: the first of patches "
        "and pca that tells where the hand will be, else none)",
    )  # fmt: skip


def cameras_of(arguments: argparse.Namespace, imitator: Imitator | None) -> CameraChoice | None:
    """Return the cameras to read, as `load_demonstrations` takes them.

    Args:
        arguments: of `pacnet fit`.
        imitator: to continue from, whose cameras they are; None for a new one.
    """
    if imitator is not None:
        return None if imitator.cameras is None else imitator.cameras.features
    if arguments.state == arguments.environment_state == [NONE]:
        return None  # pictures alone do not tell where the hand is
    if arguments.cameras is None:
        return "all"
    return None if arguments.cameras == [NONE] else arguments.cameras


def describe_cameras(
    imitator: Imitator, demonstrations: Demonstrations | None = None
) -> list[dict[str, Any]]:
    """Return what each camera tells, for JSON.

    Args:
        imitator: that has learned.
        demonstrations: what it was made from, whose other cameras are described too; None for the
            cameras that it uses.

    Returns:
        For each camera its `feature`, whether it is `used`, and whether it is in all episodes
        (`everywhere`); the `error` with which it tells where the hand will be, and that without it
        (`alone`), both with each demonstration left out and in the hand's unit, or scaled where
        postures are told, None where it was not judged; by which `encoder`, and the number of
        `demonstrations` that began with its pictures, and are kept.
    """
    own = {} if imitator.cameras is None else imitator.cameras.encoders
    used = [
        _described(feature, one.config.kind, one.told, len(one.shown), used=True)
        for feature, one in own.items()
    ]
    return used if demonstrations is None else used + _unused(imitator, demonstrations)


def _unused(imitator: Imitator, demonstrations: Demonstrations) -> list[dict[str, Any]]:
    """Return the same of the cameras that an imitator made from demonstrations does not use."""
    own = () if imitator.cameras is None else imitator.cameras.features
    reports = {one.feature: one for one in imitator.camera_reports}
    whole = [shown for shown in demonstrations if shown.first_frame == 0]
    features = dict.fromkeys(name for shown in demonstrations for name in shown.pictures)
    described = []
    for feature in (name for name in features if name not in own):
        report = reports.get(feature)
        told = None if report is None else report.told
        everywhere = all(feature in shown.pictures for shown in whole)
        described.append(_described(feature, None, told, len(whole)) | {"everywhere": everywhere})
    return described


def _described(
    feature: str, encoder: str | None, told: Told | None, demonstrations: int, used: bool = False
) -> dict[str, Any]:
    return {
        "feature": feature,
        "used": used,
        "everywhere": True,
        "encoder": encoder,
        "error": None if told is None else told.error,
        "alone": None if told is None else told.alone,
        "demonstrations": demonstrations,
    }


def camera_pairs(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return in words what `describe_cameras` returned, one pair a camera.

    Args:
        document: with that as `cameras`, and `points` as of `pacnet.cli.points.describe_points`.
    """
    moved = next(iter(document["points"]), None)
    texts = [f"{short_name(one['feature'])}: {_text(one, moved)}" for one in document["cameras"]]
    return [("cameras" if number == 0 else "", text) for number, text in enumerate(texts)]


def short_name(feature: str) -> str:
    """Return the last part of a camera's feature, such as top."""
    return feature.split(".")[-1]


def _text(camera: Mapping[str, Any], moved: str | None) -> str:
    """Return what a camera tells of where the moved point will be, or without one the posture."""
    from pacnet.vision.encoder import LEAST  # imports torch

    if camera["used"] and camera["demonstrations"] < LEAST:
        return f"tells nothing, from {LEAST} demonstrations on it may: only the same place will do"
    if camera["used"]:
        what, unit = (moved, f"the unit of {moved}") if moved else ("the posture", "scaled angles")
        judged = "" if camera["error"] < camera["alone"] else "used as asked, does not help: "
        return (
            f"{judged}where {what} will go within {camera['error']:.3g}; state alone "
            f"{camera['alone']:.3g} ({camera['encoder']}, in {unit})"
        )
    if not camera["everywhere"]:
        return "not used, since some episodes lack it"
    if camera["error"] is None:
        return _NOTHING_TOLD
    if camera["demonstrations"] < _ENOUGH:
        return f"not used: too few demonstrations to tell, from {_ENOUGH} on"
    return f"does not help: within {camera['error']:.3g}; state alone {camera['alone']:.3g}"
