"""`PACNet` for a LeRobot dataset: automatic settings, scaling, novelty."""

from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import EpisodeReport, ImitatorStep

__all__ = ["EpisodeReport", "Imitator", "ImitatorConfig", "ImitatorStep"]
