"""pacnet: perception-action coupling by imitation and attention.

After Maistros, Marom & Hayes, "Perception-Action Coupling via Imitation and Attention" (2001).
"""

from pacnet.network import PACNet, PACNetConfig, Recall
from pacnet.pid import PIDConfig, PIDController
from pacnet.schemas import MotorSchemas, MotorSchemasConfig
from pacnet.sofm import NOBODY, Attention, HabituatingSOFM, Observation
from pacnet.sofm_config import SOFMConfig

__all__ = [
    "NOBODY",
    "Attention",
    "HabituatingSOFM",
    "MotorSchemas",
    "MotorSchemasConfig",
    "Observation",
    "PACNet",
    "PACNetConfig",
    "PIDConfig",
    "PIDController",
    "Recall",
    "SOFMConfig",
]
