"""Forward models: from a target state to an action."""

from pacnet.forward_models.affine import AffineForwardModel
from pacnet.forward_models.candidates import Selection
from pacnet.forward_models.config import (
    AffineForwardModelConfig,
    MLPForwardModelConfig,
    TransitionMatrixConfig,
)
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.forward_models.pid import PIDConfig, PIDController
from pacnet.forward_models.protocol import Command, ForwardModel, OneStateForwardModel
from pacnet.forward_models.transition_matrix import TransitionMatrix

__all__ = [
    "AffineForwardModel", "AffineForwardModelConfig", "Command", "ForwardModel", "MLPForwardModel",
    "MLPForwardModelConfig", "OneStateForwardModel",
    "PIDConfig", "PIDController", "Selection", "TransitionMatrix", "TransitionMatrixConfig",
]  # fmt: skip
