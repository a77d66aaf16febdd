"""The settings of the whole network: those of its parts, which must fit one another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pacnet.attention.config import SOFMConfig
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.schemas.motor_schemas import MotorSchemasConfig


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
        """Refuses parts that do not fit one another."""
        percept, cue = self.attention.dimensions, self.schemas.percept_dimensions
        if percept != cue:
            raise ValueError(
                f"expected schemas.percept_dimensions = attention.dimensions = {percept}, got {cue}"
            )

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> PACNetConfig:
        """Rebuilds what `dataclasses.asdict` gave, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        try:
            attention, schemas = fields["attention"], fields["schemas"]
            several = "schemas_per_node" in schemas
            kind = CompetingSchemasConfig if several else MotorSchemasConfig
            return cls(SOFMConfig(**attention), kind(**schemas))
        except (KeyError, TypeError) as error:
            raise ValueError(
                f"expected the fields of PACNetConfig, got {fields}: {error}"
            ) from error
