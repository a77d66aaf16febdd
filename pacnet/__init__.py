"""pacnet: perception-action coupling by imitation and attention.

After Maistros, Marom & Hayes, "Perception-Action Coupling via Imitation and Attention" (2001).
"""

from pacnet.forward_model import Command, ForwardModel, Selection
from pacnet.mlp_forward_model import MLPForwardModel, MLPForwardModelConfig
from pacnet.network import Action, PACNet, PACNetConfig, Recall
from pacnet.pid import PIDConfig, PIDController
from pacnet.schemas import MotorSchemas, MotorSchemasConfig
from pacnet.sofm import NOBODY, Attention, HabituatingSOFM, Observation
from pacnet.sofm_config import SOFMConfig
from pacnet.targets import targets_ahead
from pacnet.transition_matrix import TransitionMatrix, TransitionMatrixConfig

__all__ = [
    "NOBODY",
    "Action",
    "Attention",
    "Command",
    "ForwardModel",
    "HabituatingSOFM",
    "MLPForwardModel",
    "MLPForwardModelConfig",
    "MotorSchemas",
    "MotorSchemasConfig",
    "Observation",
    "PACNet",
    "PACNetConfig",
    "PIDConfig",
    "PIDController",
    "Recall",
    "SOFMConfig",
    "Selection",
    "TransitionMatrix",
    "TransitionMatrixConfig",
    "targets_ahead",
]
