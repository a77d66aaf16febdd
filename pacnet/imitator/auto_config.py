"""Settings of an imitator, chosen from the demonstrations it is to learn.

The thresholds are those of Experiment 1. They suit other percepts because `noise_scaling` gives all
percepts about the same spread. Numbers of samples there are times here.
"""

from __future__ import annotations

import math
from typing import Literal

import torch
from torch import Tensor

from pacnet.attention.config import SOFMConfig
from pacnet.competition.belief import RecognitionConfig
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.core.validation import is_integer
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.forward_models.config import MLPForwardModelConfig
from pacnet.forward_models.kmeans import kmeans
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.scaling import noise_scaling
from pacnet.network.config import PACNetConfig

NOVELTY_THRESHOLD = 0.55  # activation
MIN_RADIUS = 2.0  # of a node, in lengths of the noise of a percept
WINNER_TAU = 0.1  # [s] a winner is fully habituated after three times as long
LOOKAHEAD = 0.5  # [s] after a schema, from which its continuation is learned
SAME_SCHEMA, NOVEL = 3.0, 3.0  # distances in lengths of the noise of a percept
MIN_SAME_SCHEMA, MIN_NOVEL = 0.15, 0.21  # lower bounds in scaled units, for percepts without noise
MAX_CANDIDATES = 32  # actions that a forward model chooses from
MIN_SPREAD = 0.1  # of the candidates' outcomes, in shares of the mean change; below it abstains


def choose_settings(
    demonstrations: Demonstrations, targets: Literal["action", "state"], lead: int
) -> ImitatorConfig:
    """Return settings for these demonstrations; see `Imitator.from_demonstrations`."""
    _check_features(demonstrations)
    demonstrations = demonstrations.continuous()
    percepts, action = demonstrations.percept_features, demonstrations.action_names
    state = demonstrations.state_features
    if targets == "state":
        _check_targets(demonstrations, lead)
    scaling = noise_scaling([shown.percepts for shown in demonstrations])
    fps, dimensions = demonstrations.fps, len(scaling.scale)
    attention = SOFMConfig.paper(
        dimensions,
        scale=scaling.scale,
        novelty_threshold=min(NOVELTY_THRESHOLD, math.exp(-MIN_RADIUS * scaling.noise)),
        winner_tau=max(1.0, WINNER_TAU * fps),
    )
    novel = max(MIN_NOVEL, NOVEL * scaling.noise)
    schemas = CompetingSchemasConfig(
        len(action) if targets == "action" else sum(len(percepts[name]) for name in state),
        dimensions,
        same_schema_similarity=math.exp(-max(MIN_SAME_SCHEMA, SAME_SCHEMA * scaling.noise)),
        lookahead_samples=max(1, round(LOOKAHEAD * fps)),
        recognition=RecognitionConfig(novel_above=1 - math.exp(-novel)),
    )
    return ImitatorConfig(
        percepts=percepts,
        action=action,
        fps=fps,
        targets=targets,
        lead=lead,
        network=PACNetConfig(attention, schemas),
        forward_model=_forward_model(demonstrations, lead) if targets == "state" else None,
        state=state,
        action_features=demonstrations.action_features,
    )


def _check_features(demonstrations: Demonstrations) -> None:
    """Raise a ValueError unless there are percepts and actions, of different features."""
    percepts, actions = demonstrations.percept_features, demonstrations.action_features
    if not actions:
        raise ValueError("expected demonstrations with actions to learn from, got some without")
    both = [name for name in demonstrations.state_features if name in actions]
    if both or not percepts:
        raise ValueError(
            "expected percepts and actions of different features, got "
            f"{', '.join(both or actions)!r} for both"
        )


def _check_targets(demonstrations: Demonstrations, lead: int) -> None:
    """Raise a ValueError unless there is a state `lead` frames after another."""
    if not demonstrations.state_features:
        raise ValueError(
            "expected a state of the robot to aim at with targets of 'state', got an environment "
            "state alone: name a state, or store targets of 'action'"
        )
    longest = max((len(shown.state) for shown in demonstrations), default=0)
    if not (is_integer(lead, 1) and lead < longest):
        raise ValueError(
            f"expected lead as a number of frames from 1 to {longest - 1}, less than the longest "
            f"demonstration has between gaps, got {lead!r}"
        )


def _forward_model(demonstrations: Demonstrations, lead: int) -> MLPForwardModelConfig:
    """Return settings of a forward model that chooses among the demonstrated actions."""
    actions = torch.cat([shown.action for shown in demonstrations])
    change = torch.cat([shown.state[lead:] - shown.state[:-lead] for shown in demonstrations])
    mean_change = change.double().square().mean().sqrt()
    return MLPForwardModelConfig(
        state_dimensions=change.shape[1],
        action_dimensions=actions.shape[1],
        candidates=_candidates(actions.double()),
        steps=lead,
        abstain_below=MIN_SPREAD * float(mean_change) if len(change) else 0.0,
    )


def _candidates(actions: Tensor) -> tuple[tuple[float, ...], ...]:
    """Return a few actions that represent all actions `[T, U]`."""
    different = actions.unique(dim=0)
    if len(different) < 2:
        raise ValueError(
            f"expected actions that differ, for a forward model to choose from, got "
            f"{different.tolist()} in every frame"
        )
    if len(different) > MAX_CANDIDATES:
        generator = torch.Generator().manual_seed(0)
        different, _ = kmeans(actions, MAX_CANDIDATES, generator)
    return tuple(tuple(action) for action in different.tolist())
