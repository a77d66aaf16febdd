"""The names that `pacnet` offers, which takes them from here when they are asked for."""

from pacnet.attention import NOBODY, Attention, Observation, Step
from pacnet.belief import RecognitionConfig
from pacnet.competing_schemas import CompetingSchemas
from pacnet.competing_schemas_config import CompetingSchemasConfig
from pacnet.competition import Competition, CompetitionConfig
from pacnet.demonstrations import load_demonstrations
from pacnet.ensemble import SOFMEnsemble
from pacnet.forward_model import Command, ForwardModel, OneStateForwardModel, Selection
from pacnet.imitator import Imitator
from pacnet.mlp_forward_model import MLPForwardModel, MLPForwardModelConfig
from pacnet.network import Action, Decision, PACNet, Recall
from pacnet.network_config import PACNetConfig
from pacnet.pid import PIDConfig, PIDController
from pacnet.recognition import Recognition
from pacnet.recorder import Recorder
from pacnet.schema_network import SchemaNetwork, SchemaNetworkConfig
from pacnet.schemas import MotorSchemas, MotorSchemasConfig
from pacnet.sofm import HabituatingSOFM
from pacnet.sofm_config import SOFMConfig
from pacnet.targets import targets_ahead
from pacnet.transition_matrix import TransitionMatrix, TransitionMatrixConfig

__all__ = [
    "NOBODY",
    "Action",
    "Attention",
    "Command",
    "CompetingSchemas",
    "CompetingSchemasConfig",
    "Competition",
    "CompetitionConfig",
    "Decision",
    "ForwardModel",
    "HabituatingSOFM",
    "Imitator",
    "MLPForwardModel",
    "MLPForwardModelConfig",
    "MotorSchemas",
    "MotorSchemasConfig",
    "Observation",
    "OneStateForwardModel",
    "PACNet",
    "PACNetConfig",
    "PIDConfig",
    "PIDController",
    "Recall",
    "Recognition",
    "RecognitionConfig",
    "Recorder",
    "SOFMConfig",
    "SOFMEnsemble",
    "SchemaNetwork",
    "SchemaNetworkConfig",
    "Selection",
    "Step",
    "TransitionMatrix",
    "TransitionMatrixConfig",
    "load_demonstrations",
    "targets_ahead",
]
