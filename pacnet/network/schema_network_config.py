"""Every choice of the schema network in one place."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pacnet.competition.winner_take_all import CompetitionConfig
from pacnet.core.checkpoint import rebuild_config
from pacnet.core.validation import check_fields, is_integer, is_number


@dataclass(frozen=True)
class SchemaNetworkConfig:
    """Settings of a `SchemaNetwork`.

    Attributes:
        percept_dimensions: length D of a percept.
        target_dimensions: length A of an internal target.
        scale: factor on each dimension of a percept before distances are taken, in 1/unit of that
            dimension; None stands for ones.
        width: distance [scaled units] at which a confidence falls to 1/e.
        competition: the rules by which one of the schemas wins. Its threshold is also the
            confidence from which a schema's motor schema is active.
    """

    percept_dimensions: int
    target_dimensions: int
    scale: tuple[float, ...] | None = None
    width: float = 1.0
    competition: CompetitionConfig = field(default_factory=CompetitionConfig)

    def __post_init__(self) -> None:
        """Refuses values that have no meaning."""
        if isinstance(self.scale, list):  # as JSON gives it
            object.__setattr__(self, "scale", tuple(self.scale))
        dimensions = self.percept_dimensions
        check_fields(self, {"percept_dimensions": (is_integer(dimensions, 1), "≥ 1")})
        check_fields(
            self,
            {
                "target_dimensions": (is_integer(self.target_dimensions, 1), "≥ 1"),
                "scale": (self._scale_is_valid(), f"to be {dimensions} positive finite factors"),
                "width": (is_number(self.width) and self.width > 0, "> 0 and finite"),
                "competition": (
                    isinstance(self.competition, CompetitionConfig),
                    "to be a CompetitionConfig",
                ),
            },
        )

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> SchemaNetworkConfig:
        """Rebuilds what `dataclasses.asdict` gave, after JSON.

        Raises:
            ValueError: a field is missing, unknown or out of range.
        """
        competition = fields.get("competition")
        if isinstance(competition, dict):
            fields = {**fields, "competition": rebuild_config(CompetitionConfig, competition)}
        return rebuild_config(cls, fields)

    def _scale_is_valid(self) -> bool:
        if self.scale is None:
            return True
        return (
            isinstance(self.scale, tuple)
            and len(self.scale) == self.percept_dimensions
            and all(is_number(factor) and factor > 0 for factor in self.scale)
        )
