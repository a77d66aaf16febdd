"""The settings of both networks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pacnet.attention.config import SOFMConfig
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.competition.winner_take_all import CompetitionConfig
from pacnet.core.checkpoint import rebuild_config
from pacnet.core.old_names import with_new_names
from pacnet.core.validation import check_fields, is_integer, is_number
from pacnet.schemas.motor_schemas import MotorSchemasConfig

_KINDS = {config.type: config for config in (MotorSchemasConfig, CompetingSchemasConfig)}


@dataclass(frozen=True)
class PACNetConfig:
    """Settings of the parts of a `PACNet`, which must fit one another.

    Attributes:
        attention: the growing map.
        schemas: the motor schemas, one per node as in the paper or several that compete; their
            cues are as long as the map's percepts.
    """

    attention: SOFMConfig
    schemas: MotorSchemasConfig | CompetingSchemasConfig

    def __post_init__(self) -> None:
        """Check that the parts fit one another."""
        percept, cue = self.attention.dimensions, self.schemas.percept_dimensions
        if percept != cue:
            raise ValueError(
                f"expected schemas.percept_dimensions = attention.dimensions = {percept}, got {cue}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as JSON holds them, with the kind of motor schemas as their `type`."""
        schemas = {"type": self.schemas.type, **asdict(self.schemas)}
        return {"attention": asdict(self.attention), "schemas": schemas}

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> PACNetConfig:
        """Rebuild what `to_dict` gave, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        try:
            attention, schemas = fields["attention"], dict(fields["schemas"])
            several = "schemas_per_node" in schemas  # before there was a type
            kind = _KINDS[schemas.pop("type", "competing_schemas" if several else "motor_schemas")]
            return cls(SOFMConfig(**attention), kind(**with_new_names(kind, schemas)))
        except (KeyError, TypeError) as error:
            raise ValueError(
                f"expected the fields of PACNetConfig, got {fields}: {error}"
            ) from error


@dataclass(frozen=True)
class SchemaNetworkConfig:
    """Settings of a `SchemaNetwork`.

    Attributes:
        percept_dimensions: length D of a percept.
        target_dimensions: length A of a target.
        scale: factor on each dimension of a percept before distances are computed, in 1/unit of
            that dimension; None stands for ones.
        width: distance [scaled units] at which a confidence falls to 1/e.
        competition: the rules by which one of the schemas wins. Its threshold is also the
            confidence from which a schema's motor schema is active.

    Raises:
        ValueError: a field of another type or out of range.
    """

    percept_dimensions: int
    target_dimensions: int
    scale: tuple[float, ...] | None = None
    width: float = 1.0
    competition: CompetitionConfig = field(default_factory=CompetitionConfig)

    def __post_init__(self) -> None:
        """Validate the fields and turn the scale into a tuple (JSON has lists)."""
        if isinstance(self.scale, list):
            object.__setattr__(self, "scale", tuple(self.scale))
        dimensions, scale = self.percept_dimensions, self.scale
        is_scale = scale is None or (
            isinstance(scale, tuple)
            and len(scale) == dimensions
            and all(is_number(factor) and factor > 0 for factor in scale)
        )
        is_competition = isinstance(self.competition, CompetitionConfig)
        check_fields(
            self,
            {
                "percept_dimensions": (is_integer(dimensions, 1), "≥ 1"),
                "target_dimensions": (is_integer(self.target_dimensions, 1), "≥ 1"),
                "scale": (is_scale, f"to be {dimensions} positive finite factors"),
                "width": (is_number(self.width) and self.width > 0, "> 0 and finite"),
                "competition": (is_competition, "to be a CompetitionConfig"),
            },
        )

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> SchemaNetworkConfig:
        """Return the config from the output of `dataclasses.asdict`, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        competition = fields.get("competition")
        if isinstance(competition, dict):
            fields = {**fields, "competition": rebuild_config(CompetitionConfig, competition)}
        return rebuild_config(cls, fields)
