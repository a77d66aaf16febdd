"""The growing map with habituation: a percept goes in, its winner and its novelty come out."""

from pacnet.attention.config import SOFMConfig
from pacnet.attention.ensemble import SOFMEnsemble
from pacnet.attention.records import NO_NODE, Attention, Observation, Step
from pacnet.attention.sofm import HabituatingSOFM

__all__ = [
    "NO_NODE", "Attention", "HabituatingSOFM", "Observation", "SOFMConfig", "SOFMEnsemble", "Step",
]  # fmt: skip
