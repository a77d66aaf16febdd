"""Every choice of competing motor schemas in one place."""

from __future__ import annotations

from dataclasses import dataclass, field

from pacnet.competition.belief import RecognitionConfig
from pacnet.competition.winner_take_all import CompetitionConfig
from pacnet.core.validation import LONGEST, check_fields, is_integer, is_number


@dataclass(frozen=True)
class CompetingSchemasConfig:
    """How schemas are told apart, retrained and recalled.

    Attributes:
        target_dimensions: length A of a target.
        percept_dimensions: length D of a cue.
        schemas_per_node: how many different schemas a node keeps. Where it keeps as many, each seen
            more than once, it takes no further kind.
        alike_above: two schemas of a node are the same, seen twice, where exp(−distance) is at
            least this: the distance between their cues, and between what came after them. Twice the
            length of the noise of a percept, in scaled units, is a good distance.
        continuation: samples after a schema's last at which is seen what came after it: half a
            second, at the rate of the data. A node that wins again within as many goes on with its
            schema.
        worse_by: how much worse than what is kept an episode may be and still renew it, in [0, 1);
            see `pacnet.schemas.consolidation`.
        nearest_cues: over how many of the nearest cues a recalled target is averaged.
        threshold: confidence under which a schema does not compete; see `Competition`.
        margin: by how much more confident than the incumbent a challenger must be.
        recognition: of what is being watched.
    """

    target_dimensions: int
    percept_dimensions: int
    schemas_per_node: int = 8
    alike_above: float = 0.82
    continuation: int = 25
    worse_by: float = 0.25
    nearest_cues: int = 1
    threshold: float = 0.01
    margin: float = 0.1
    recognition: RecognitionConfig = field(default_factory=RecognitionConfig)

    def __post_init__(self) -> None:
        """Refuses values that have no meaning."""
        if isinstance(self.recognition, dict):  # as JSON gives it
            object.__setattr__(self, "recognition", RecognitionConfig(**self.recognition))
        integers = ("target_dimensions", "percept_dimensions", "schemas_per_node", "nearest_cues")
        checks = {name: (is_integer(getattr(self, name), 1), "≥ 1") for name in integers}
        alike, worse = self.alike_above, self.worse_by
        checks["alike_above"] = (is_number(alike) and 0 < alike < 1, "in (0, 1)")
        after = self.continuation
        checks["continuation"] = (
            is_integer(after, 1) and after <= LONGEST,
            f"from 1 to {LONGEST} samples",
        )
        checks["worse_by"] = (is_number(worse) and 0 <= worse < 1, "in [0, 1)")
        wanted = "to be a RecognitionConfig"
        checks["recognition"] = (isinstance(self.recognition, RecognitionConfig), wanted)
        check_fields(self, checks)
        CompetitionConfig(self.threshold, self.margin)  # refuses the rest
