"""Settings of competing motor schemas."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from pacnet.competition.belief import RecognitionConfig
from pacnet.competition.winner_take_all import CompetitionConfig
from pacnet.core.old_names import old_names, with_new_names
from pacnet.core.validation import check_fields, is_integer
from pacnet.schemas.memory import EpisodicMemoryConfig


@old_names(
    alike_above="same_schema_similarity",
    continuation="lookahead_samples",
    worse_by="max_quality_drop",
)
@dataclass(frozen=True)
class CompetingSchemasConfig(EpisodicMemoryConfig):
    """How schemas are distinguished and consolidated (`EpisodicMemoryConfig`), and recalled.

    They have no budget of targets, as `MotorSchemasConfig` has: `schemas_per_node` bounds them.

    Attributes:
        nearest_cues: number of nearest cues whose targets are averaged.
        threshold: confidence under which a schema does not compete; see `Competition`.
        margin: by how much more confident than the incumbent a challenger must be.
        recognition: how known episodes are recognized.
        type: which kind of motor schemas it is, in a checkpoint's `config.json`.
    """

    nearest_cues: int = 1
    threshold: float = 0.01
    margin: float = 0.1
    recognition: RecognitionConfig = field(default_factory=RecognitionConfig)
    type: ClassVar[str] = "competing_schemas"

    def __post_init__(self) -> None:
        """Validate the fields."""
        super().__post_init__()
        if isinstance(self.recognition, dict):  # as JSON gives it
            fields = with_new_names(RecognitionConfig, self.recognition)
            object.__setattr__(self, "recognition", RecognitionConfig(**fields))
        checks = {
            "nearest_cues": (is_integer(self.nearest_cues, 1), "≥ 1"),
            "recognition": (
                isinstance(self.recognition, RecognitionConfig),
                "to be a RecognitionConfig",
            ),
        }
        check_fields(self, checks)
        CompetitionConfig(self.threshold, self.margin)  # validates both
