"""What a policy's settings say of its imitator, and whether they are those it was learned with."""

from __future__ import annotations

from lerobot_policy_pacnet.configuration_pacnet import PACNetConfig
from lerobot_policy_pacnet.description import DatasetDescription
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.points import PointsChoice, parse_points
from pacnet.schemas.points import Points


def points_of(config: PACNetConfig) -> PointsChoice:
    """Return the points that are asked for, as `Imitator.from_demonstrations` takes them."""
    return "auto" if config.points is None else config.points or None


def check_points(config: PACNetConfig, dataset: DatasetDescription) -> None:
    """Raise a ValueError unless the points that are asked for are of the dataset's features."""
    if config.points:
        parse_points(config.points, dataset.percepts)


def check_settings(config: PACNetConfig, base: Imitator) -> None:
    """Raise a ValueError unless an imitator was learned with these settings."""
    wanted, got = base.config.targets, config.targets
    if wanted != got:
        raise ValueError(f"expected policy.targets={wanted}, as learned before, got {got}")
    wanted, got = base.config.lead, config.lead
    if wanted != got and base.config.targets == "state":
        raise ValueError(f"expected policy.lead={wanted}, as learned before, got {got}")
    wanted = base.config.points
    got = parse_points(config.points, base.config.percepts) if config.points else None
    if config.points is not None and got != wanted:
        raise ValueError(
            f"expected policy.points of the dimensions {_dimensions(wanted)}, as learned before, "
            f"got {_dimensions(got)}"
        )


def _dimensions(points: Points | None) -> str:
    """Return the dimensions of each point in words."""
    if points is None:
        return "none"
    return ", ".join(f"{point.name} {[*point.used]}" for point in points)
