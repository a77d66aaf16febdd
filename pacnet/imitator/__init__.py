"""`PACNet` around somebody's dataset: automatic settings, scaling, novelty."""

from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.imitator import Imitator, ImitatorStep

__all__ = ["Imitator", "ImitatorConfig", "ImitatorStep"]
