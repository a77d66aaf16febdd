"""Small models that choose among candidate actions, for the tests of this folder."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from pacnet.forward_models.config import MLPForwardModelConfig, TransitionMatrixConfig
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.forward_models.transition_matrix import TransitionMatrix

STATES, ACTIONS = 3, 2
TURNS = ((-1.0,), (0.0,), (2.0,))


def random_model(
    hidden: tuple[int, ...] = (5,), number: int = 21, steps: int = 1, abstain_below: float = 0.0
) -> MLPForwardModel:
    """A model before `fit`, with random candidates, normalisers and range."""
    generator = torch.Generator().manual_seed(number)
    candidates = torch.randn(number, ACTIONS, generator=generator).tolist()
    config = MLPForwardModelConfig(
        STATES, ACTIONS, candidates, hidden=hidden, steps=steps, abstain_below=abstain_below
    )
    model = MLPForwardModel(config, seed=1)
    for name, buffer in model.named_buffers():
        if name.endswith(("mean", "std")):
            drawn = torch.rand(len(buffer), generator=generator, dtype=torch.float64)
            buffer.copy_(drawn + 0.2 if name.endswith("std") else drawn - 0.5)
    model.state_low.copy_(torch.tensor([-1.5, -1.0, -2.0]))
    model.state_high.copy_(torch.tensor([1.5, 2.0, 1.0]))
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.3 * torch.randn(parameter.shape, generator=generator))
    return model


def hand_set(
    gain: float, candidates: tuple[tuple[float, ...], ...] = TURNS, **fields: float
) -> MLPForwardModel:
    """From state x, action a leads to x / 2 + gain × a, exact in any float type."""
    model = MLPForwardModel(MLPForwardModelConfig(1, 1, candidates, hidden=(), **fields))
    weights = {"weight": torch.tensor([[-0.5, gain]]), "bias": torch.zeros(1)}
    model.network[0].load_state_dict(weights)
    return model


def small_matrix() -> TransitionMatrix:
    return TransitionMatrix(TransitionMatrixConfig(1, 1, ((0.0,), (1.0,)), clusters=2))


def random_rows(number: int, seed: int = 0) -> Tensor:
    return torch.randn(number, STATES, generator=torch.Generator().manual_seed(seed))


def command_one_by_one(model: MLPForwardModel, states: Tensor, targets: Tensor) -> Tensor:
    """The actions of `command_one` for each row; NaN where the model abstains."""
    none = np.full(model.action_dimensions, np.nan, np.float32)
    pairs = zip(states.numpy(), targets.numpy(), strict=True)
    actions = [model.command_one(*pair) for pair in pairs]
    return torch.from_numpy(np.stack([none if action is None else action for action in actions]))


def command_rows(model: MLPForwardModel, states: Tensor, targets: Tensor) -> Tensor:
    """The actions of `command`, in float32."""
    like = model.candidates
    return model.command(states.to(like), targets.to(like)).action.float()


def snapshot(model: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in model.state_dict().items()}
