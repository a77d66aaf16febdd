"""The forward model of Experiment 2: how a pair of wheel speeds changes the six readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from envs.khepera import INFRARED_NAMES, wheel_speeds
from envs.wall_behaviours import CRUISE, MAX_TURN
from pacnet import MLPForwardModel, MLPForwardModelConfig
from pacnet.forward_models.fitting import MAX_EPOCHS, FitReport
from train.walls.drivers import shares
from train.walls.episodes import Transitions
from train.walls.learning import LEAD, WHEEL_NAMES, Episode

ABSTAIN_BELOW = 0.0  # never: choosing between outcomes that are alike does no harm here
TURNS = np.linspace(-MAX_TURN, MAX_TURN, 21)  # [rad/s] of the candidate actions


def candidate_actions(speeds: Sequence[float] = (CRUISE,)) -> tuple[tuple[float, ...], ...]:
    """Return every turn at every speed [m/s], as actions of the environment."""
    wheels = [wheel_speeds(speed, turn) for speed in speeds for turn in TURNS]
    return tuple(tuple(shares(pair).tolist()) for pair in wheels)


def make_forward_model(seed: int, speeds: Sequence[float] = (CRUISE,)) -> MLPForwardModel:
    """Return an unfitted forward model for this robot, with weights drawn from the seed."""
    config = MLPForwardModelConfig(
        state_dimensions=len(INFRARED_NAMES),
        action_dimensions=len(WHEEL_NAMES),
        candidates=candidate_actions(speeds),
        steps=LEAD,
        abstain_below=ABSTAIN_BELOW,
    )
    return MLPForwardModel(config, seed=seed)


def fit(
    model: MLPForwardModel, walks: Sequence[Transitions], seed: int
) -> tuple[FitReport, Tensor]:
    """Fit a forward model to walks and to their mirror images: the body is symmetric.

    Returns:
        The report, and the training and validation loss after each epoch `[E, 2]`.
    """
    rows = [torch.cat([rows, rows.flip(1)]) for rows in changes(walks)]
    losses = []
    with tqdm(total=MAX_EPOCHS, desc="fitting", unit="epoch") as progress:

        def note(_: int, train_loss: float, validation_loss: float) -> None:
            losses.append((train_loss, validation_loss))
            progress.update()

        report = model.fit(*rows, seed=seed, progress=note)
        progress.total = progress.n  # it may have stopped early
    return report, torch.tensor(losses)


def changes(walks: Sequence[Transitions]) -> tuple[Tensor, Tensor, Tensor]:
    """Return percepts, actions and next percepts of all walks; none leads to another walk."""
    steps = [(percepts[:-1], actions[:-1], percepts[1:]) for percepts, actions in walks]
    before, actions, after = zip(*steps, strict=True)
    return _joined(before), _joined(actions), _joined(after)


def walks_of(wandering: Transitions, episodes: Sequence[Episode]) -> list[Transitions]:
    """Return all walks in which the robot felt its own wheels: wandering, and following."""
    followed = [Transitions(one.percepts.numpy(), one.actions.numpy()) for one in episodes]
    return [wandering, *followed]


def _joined(walks: Sequence[np.ndarray]) -> Tensor:
    return torch.from_numpy(np.concatenate(walks))
