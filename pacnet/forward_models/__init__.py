"""Forward models: from a target state to an action."""

from pacnet.forward_models.affine import AffineForwardModel
from pacnet.forward_models.candidates import Selection
from pacnet.forward_models.config import (
    AffineForwardModelConfig,
    KinematicModelConfig,
    MLPForwardModelConfig,
    TransitionMatrixConfig,
)
from pacnet.forward_models.kinematic_arrays import HandPose, KinematicFit, Reach
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.forward_models.pid import PIDConfig, PIDController
from pacnet.forward_models.protocol import Command, ForwardModel, OneStateForwardModel
from pacnet.forward_models.transition_matrix import TransitionMatrix

__all__ = [
    "AffineForwardModel", "AffineForwardModelConfig", "Command", "ForwardModel", "HandPose",
    "KinematicFit", "KinematicModel", "KinematicModelConfig", "MLPForwardModel",
    "MLPForwardModelConfig", "OneStateForwardModel",
    "PIDConfig", "PIDController", "Reach", "Selection", "TransitionMatrix",
    "TransitionMatrixConfig",
]  # fmt: skip
