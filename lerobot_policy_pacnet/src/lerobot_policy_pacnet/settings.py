"""What a policy's settings say of its imitator, and whether they are those it was learned with."""

from __future__ import annotations

from lerobot.utils.constants import ACTION

from lerobot_policy_pacnet.configuration_pacnet import PACNetConfig
from lerobot_policy_pacnet.description import DatasetDescription
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.body import landmarks_of, named_angles
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.points import PointsChoice, parse_points
from pacnet.schemas.points import Point


def points_of(config: PACNetConfig) -> PointsChoice:
    """Return the points that are asked for, as `Imitator.from_demonstrations` takes them."""
    return "auto" if config.points is None else config.points or None


def body_of(config: PACNetConfig) -> KinematicModel | None:
    """Return the model of the body that is asked for; None for none.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: it is damaged, or of something else.
    """
    return None if config.body is None else KinematicModel.from_pretrained(config.body)


def body_kept_by(imitator: Imitator) -> KinematicModel | None:
    """Return the model of the body that an imitator has; None for none."""
    return None if imitator.frames is None else imitator.frames.body


def check_points(
    config: PACNetConfig, body: KinematicModel | None, dataset: DatasetDescription
) -> None:
    """Raise a ValueError unless points and body that are asked for are of the dataset's features.

    Args:
        config: of the policy.
        body: that the imitator will have; None for none.
        dataset: to learn.
    """
    if body is not None:
        landmarks_of(points_of(config), dataset.percepts)
        named_angles(body.config, dataset.percepts, dataset.names[ACTION])
    elif config.points:
        parse_points(config.points, dataset.percepts)


def check_settings(config: PACNetConfig, base: Imitator) -> None:
    """Raise a ValueError unless an imitator was learned with these settings.

    Raises:
        FileNotFoundError: no body is where the settings say.
    """
    wanted, got = base.config.targets, config.targets
    if wanted != got:
        raise ValueError(f"expected policy.targets={wanted}, as learned before, got {got}")
    wanted, got = base.config.lead, config.lead
    if wanted != got and base.config.targets == "state":
        raise ValueError(f"expected policy.lead={wanted}, as learned before, got {got}")
    _check_body(config, base)
    _check_cameras(config, base)
    if config.points is not None:
        _check_same_points(config, base)


def _check_body(config: PACNetConfig, base: Imitator) -> None:
    """Check that the body that is named, if one is, is that of an imitator."""
    body = body_of(config)
    if body is None or (base.frames is not None and base.frames.has_body(body)):
        return
    own = "no body" if body_kept_by(base) is None else "the body"
    raise ValueError(
        f"expected {own} that was learned with, which is kept without policy.body, got another in "
        f"'{config.body}'"
    )


def _check_cameras(config: PACNetConfig, base: Imitator) -> None:
    """Check that the cameras that an imitator looks at are there."""
    learned = () if base.cameras is None else base.cameras.features
    missing = [name for name in learned if name not in config.camera_features]
    if missing:
        got = ", ".join(config.camera_features) or "none"
        raise ValueError(f"expected the camera {missing[0]!r}, as learned before, got {got}")


def _check_same_points(config: PACNetConfig, base: Imitator) -> None:
    percepts, frames, asked = base.config.percepts, base.config.frames, config.points or []
    if body_kept_by(base) is not None and frames is not None:
        wanted = frames.perceived
        got = landmarks_of(asked, percepts) if asked else ()
    else:
        wanted = () if frames is None else tuple(frames.points)
        got = tuple(parse_points(asked, percepts)) if asked else ()
    if got != wanted:
        raise ValueError(
            f"expected policy.points of the dimensions {_dimensions(wanted)}, as learned before, "
            f"got {_dimensions(got)}"
        )


def _dimensions(points: tuple[Point, ...]) -> str:
    """Return the dimensions of each point in words."""
    return ", ".join(f"{point.name} {[*point.used]}" for point in points) or "none"
