"""What an imitator perceives and does, by name, and the settings of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from pacnet.core.validation import check_fields, is_integer, is_number
from pacnet.datasets.demonstrations import dimension_names
from pacnet.forward_models.mlp import MLPForwardModelConfig
from pacnet.network.config import PACNetConfig


@dataclass(frozen=True)
class ImitatorConfig:
    """Settings of an `Imitator`; `Imitator.from_demonstrations` makes them from demonstrations.

    Attributes:
        percepts: feature -> names of its dimensions, in the order of the percept; the first
            feature is the robot's state.
        action: names of the action's dimensions.
        fps: frames per second of the demonstrations [1/s].
        targets: what motor schemas keep: the demonstrated `action`, or the `state` that followed
            `lead` frames later, to which a forward model finds the way.
        lead: frames that a `state` lies ahead, ≥ 1.
        network: of the map and the schemas; the map's scale is the normaliser of percepts.
        forward_model: for targets that are states.
    """

    percepts: Mapping[str, tuple[str, ...]]
    action: tuple[str, ...]
    fps: float
    targets: Literal["action", "state"]
    lead: int
    network: PACNetConfig
    forward_model: MLPForwardModelConfig | None = None

    def __post_init__(self) -> None:
        """Turns sequences (JSON reads lists) into tuples and refuses what does not fit together."""
        percepts = {feature: tuple(names) for feature, names in self.percepts.items()}
        object.__setattr__(self, "percepts", percepts)
        object.__setattr__(self, "action", tuple(self.action))
        wants_model, has_model = self.targets == "state", self.forward_model is not None
        dimensions = self.network.attention.dimensions
        state = next(iter(percepts.values()), ())
        length = len(state if wants_model else self.action)
        checks = {
            "percepts": (len(self.percept_names) == dimensions, f"of {dimensions} dimensions"),
            "fps": (is_number(self.fps) and self.fps > 0, "> 0"),
            "targets": (self.targets in ("action", "state"), '"action" or "state"'),
            "lead": (is_integer(self.lead, 1), "≥ 1"),
            "forward_model": (wants_model == has_model, "where targets are states, and only there"),
            "network": (
                self.network.schemas.target_dimensions == length,
                f"with {length} target dimensions",
            ),
        }
        check_fields(self, checks)

    @property
    def state_dimensions(self) -> int:
        """Length S of the robot's state, the beginning of a percept."""
        return len(next(iter(self.percepts.values())))

    @cached_property  # asked for at every step of a control loop
    def percept_names(self) -> tuple[str, ...]:
        """Names of a percept's D dimensions."""
        return dimension_names(self.percepts)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> ImitatorConfig:
        """Rebuilds what `dataclasses.asdict` gave, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        try:
            network = PACNetConfig.from_dict(fields["network"])
            model = fields["forward_model"]
            model = None if model is None else MLPForwardModelConfig(**model)
            return cls(**{**fields, "network": network, "forward_model": model})
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f"expected the fields of ImitatorConfig, got {error!r}") from error
