"""Which forward model finds the actions that lead to states: an affine law, or else a network.

The affine one needs a single demonstration and gives any action. A network needs many transitions
and chooses among candidate actions. It is tried only where the affine one predicts little, as of
distances to walls, and used where it predicts held-out frames better.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from pacnet.datasets.demonstrations import Demonstration
from pacnet.forward_models.affine import AffineForwardModel
from pacnet.forward_models.affine_rows import mean_ahead
from pacnet.forward_models.config import AffineForwardModelConfig, MLPForwardModelConfig
from pacnet.forward_models.fitting import BLOCK, r2_of_change
from pacnet.forward_models.kmeans import kmeans
from pacnet.forward_models.mlp import MLPForwardModel

AFFINE, NETWORK = "affine", "network"  # names of the models
MAX_CANDIDATES = 32  # actions that a network chooses from
MIN_SPREAD = 0.1  # of the candidates' outcomes, in shares of the mean change; below it abstains
ENOUGH = 0.5  # share of the change that an affine law predicts, from which no network is tried

Model = AffineForwardModel | MLPForwardModel


class Chosen(NamedTuple):
    """A forward model for some demonstrations."""

    config: AffineForwardModelConfig | MLPForwardModelConfig | None
    explained: dict[str, float]
    """Model that was tried -> share of the change of state it predicts in frames held out."""
    still_actions: tuple[int, ...]
    """Numbers of the actions that do not move the state."""


NO_MODEL = Chosen(None, {}, ())


def choose_forward_model(
    episodes: Sequence[Demonstration], follows: Sequence[int], lead: int
) -> Chosen:
    """Return the model that predicts best how the state changes over `lead` frames.

    Args:
        episodes: continuous ones.
        follows: for each action the dimension of the state that it is a place of, −1 for none.
        lead: frames that a target lies ahead.

    Raises:
        ValueError: actions that never differ, or too few frames.
    """
    different = torch.cat([one.action for one in episodes]).unique(dim=0)
    if len(different) < 2:
        raise ValueError(
            f"expected actions that differ, for a forward model to find them, got "
            f"{different.tolist()} in every frame"
        )
    states, actions = episodes[0].state.shape[1], episodes[0].action.shape[1]
    affine = AffineForwardModel(AffineForwardModelConfig(states, actions, lead, tuple(follows)))
    moving = torch.cat([one.state.diff(dim=0) for one in episodes]).any(dim=0)
    explained = {AFFINE: _mean(fit(affine, episodes), moving)}
    still = tuple((~affine.moves).nonzero().ravel().tolist())
    if explained[AFFINE] < ENOUGH and sum(len(one.state) - 1 for one in episodes) >= 2 * BLOCK:
        network = MLPForwardModel(_candidate_settings(episodes, lead))
        explained[NETWORK] = _mean(fit(network, episodes), moving)
        if explained[NETWORK] > explained[AFFINE]:
            return Chosen(network.config, explained, ())
    return Chosen(affine.config, explained, still)


def make_model(config: AffineForwardModelConfig | MLPForwardModelConfig | None) -> Model | None:
    """Return a model with these settings that has learned nothing."""
    if isinstance(config, AffineForwardModelConfig):
        return AffineForwardModel(config)
    return None if config is None else MLPForwardModel(config)


def class_of(config: AffineForwardModelConfig | MLPForwardModelConfig) -> type[Model]:
    """Return the class of the model with these settings."""
    is_affine = isinstance(config, AffineForwardModelConfig)
    return AffineForwardModel if is_affine else MLPForwardModel


def fit(model: Model, episodes: Sequence[Demonstration]) -> Tensor:
    """Fit a model to all frames of continuous episodes.

    Returns:
        The share of the change over its lead that it predicts in frames held out, `[S]`.

    Raises:
        ValueError: too few frames.
    """
    states, actions = [one.state for one in episodes], [one.action for one in episodes]
    if isinstance(model, AffineForwardModel):
        return model.fit(states, actions)
    report = model.fit(
        torch.cat([state[:-1] for state in states]),
        torch.cat([action[:-1] for action in actions]),
        torch.cat([state[1:] for state in states]),
        seed=0,
    )
    return _explained(model, states, actions, set(report.validation_rows.tolist()))


def _explained(
    model: MLPForwardModel, states: list[Tensor], actions: list[Tensor], held_out: set[int]
) -> Tensor:
    """Return the share of the change over its steps that is predicted in held-out rows, `[S]`."""
    lead, first, changes, predicted = model.config.steps, 0, [], []
    for state, action in zip(states, actions, strict=True):
        rows = [row for row in range(len(state) - lead) if first + row in held_out]
        first += len(state) - 1
        if not rows:
            continue
        sent = torch.from_numpy(mean_ahead(action.double().numpy(), lead)[rows])
        now = state[rows]
        predicted.append(model.predict(now, sent.to(state)).detach() - now)
        changes.append(state[np.array(rows) + lead] - now)
    if not changes:  # the held-out frames are the last ones
        return states[0].new_zeros(model.config.state_dimensions)
    return r2_of_change(torch.cat(changes), torch.cat(predicted))


def _mean(shares: Tensor, moving: Tensor) -> float:
    """Return the mean over the dimensions that move; 0 if none does."""
    return float(shares[moving].mean()) if bool(moving.any()) else 0.0


def _candidate_settings(episodes: Sequence[Demonstration], lead: int) -> MLPForwardModelConfig:
    """Return settings of a network that chooses among the demonstrated actions."""
    actions = torch.cat([one.action for one in episodes]).double()
    change = torch.cat([one.state[lead:] - one.state[:-lead] for one in episodes])
    candidates = actions.unique(dim=0)
    if len(candidates) > MAX_CANDIDATES:
        candidates, _ = kmeans(actions, MAX_CANDIDATES, torch.Generator().manual_seed(0))
    return MLPForwardModelConfig(
        state_dimensions=change.shape[1],
        action_dimensions=actions.shape[1],
        candidates=tuple(tuple(action) for action in candidates.tolist()),
        steps=lead,
        abstain_below=MIN_SPREAD * float(change.double().square().mean().sqrt()),
    )
