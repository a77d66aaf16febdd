"""A network that learns where the hand is, to compare with: two hidden layers on angles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.forward_models.kinematic_arrays import HandPose
from pacnet.forward_models.turn_matrices import matrices_of, nearest_turns
from train.postural.babbling.recording import Babble

STEPS, BATCH, RATE = 5000, 256, 1e-2  # of Adam; the rate falls to 0 as a cosine does


class PoseNetwork(NamedTuple):
    """A fitted network, and what its outputs are scaled by."""

    layers: nn.Module
    mean: Tensor  # [12]
    std: Tensor  # [12]
    waves: bool  # whether angles enter as sines and cosines

    def __call__(self, angles: Tensor) -> HandPose:
        """Return where the hand is in postures `[N, J]` [rad], as `KinematicModel`."""
        with torch.no_grad():
            pose = self.layers(_inputs(angles, self.waves)).double() * self.std + self.mean
        return HandPose(pose[:, :3], nearest_turns(pose[:, 3:].unflatten(-1, (3, 3))))


def fit_network(babble: Babble, width: int, waves: bool, seed: int) -> PoseNetwork:
    """Fit places and rotation matrices.

    Args:
        babble: What was seen.
        width: Units of each hidden layer.
        waves: Whether angles enter as sines and cosines.
        seed: Of weights and batches.
    """
    matrices = matrices_of(torch.from_numpy(babble.turns)).flatten(1)
    poses = torch.cat([torch.from_numpy(babble.places), matrices], dim=1)
    mean, std = poses.mean(dim=0), poses.std(dim=0)
    inputs, outputs = _inputs(torch.from_numpy(babble.angles), waves), (poses - mean) / std
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        sizes = (inputs.shape[1], width, width)
        layers = nn.Sequential(
            nn.Linear(*sizes[:2]), nn.SiLU(), nn.Linear(*sizes[1:]), nn.SiLU(), nn.Linear(width, 12)
        )
    _train(layers, inputs, outputs.float(), np.random.default_rng(seed))
    return PoseNetwork(layers, mean, std, waves)


def _train(layers: nn.Module, inputs: Tensor, outputs: Tensor, rng: np.random.Generator) -> None:
    """Make the mean squared error least."""
    optimiser = torch.optim.Adam(layers.parameters(), RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for _ in range(STEPS):
        rows: NDArray[np.int64] = rng.integers(len(inputs), size=BATCH)
        loss = nn.functional.mse_loss(layers(inputs[rows]), outputs[rows])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()


def _inputs(angles: Tensor, waves: bool) -> Tensor:
    return (torch.cat([angles.sin(), angles.cos()], dim=1) if waves else angles).float()
