"""The settings of the whole network: those of its parts, which must fit one another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pacnet.attention.config import SOFMConfig
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.core.old_names import with_new_names
from pacnet.schemas.motor_schemas import MotorSchemasConfig

_KINDS = {config.type: config for config in (MotorSchemasConfig, CompetingSchemasConfig)}


@dataclass(frozen=True)
class PACNetConfig:
    """Settings of the network's parts.

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

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> PACNetConfig:
        """Rebuild what `dataclasses.asdict` gave, after JSON.

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
