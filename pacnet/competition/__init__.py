"""Competition of motor schemas, and recognition of known episodes."""

from pacnet.competition.belief import RecognitionConfig
from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.competition.recognition import Recognition
from pacnet.competition.winner_take_all import NO_SCHEMA, Competition, CompetitionConfig

__all__ = [
    "NO_SCHEMA",
    "CompetingSchemas",
    "CompetingSchemasConfig",
    "Competition",
    "CompetitionConfig",
    "Recognition",
    "RecognitionConfig",
]
