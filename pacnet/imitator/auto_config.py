"""Settings of an imitator that nobody has tuned, chosen from the demonstrations it is to learn.

The thresholds are those of Experiment 1, whose percepts have about the spread, in scaled units,
that `noise_scaling` gives to any; what counts samples there is taken as time, for other rates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor

from pacnet.attention.config import SOFMConfig
from pacnet.competition.belief import RecognitionConfig
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.core.validation import is_integer
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.kmeans import kmeans
from pacnet.forward_models.mlp import MLPForwardModelConfig
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.scaling import noise_scaling
from pacnet.network.config import PACNetConfig

NOVELTY_THRESHOLD = 0.55  # activation
RADIUS = 2.0  # of a node, at least, in lengths of the noise of a percept
SETTLING = 0.1  # [s] τ of a winner: three times as long and it is fully habituated
SEEN_AFTER = 0.5  # [s] after a schema's end, in which is seen what came after it
ALIKE, UNUSUAL = 3.0, 3.0  # lengths of the noise of a percept: of one schema, not novel
LEAST_ALIKE, LEAST_UNUSUAL = 0.15, 0.21  # the same in scaled units, for percepts without noise
CANDIDATES = 32  # actions that a forward model chooses from, at most
INDIFFERENT = 0.1  # spread of their outcomes, in shares of the usual change, that is no choice


def choose_settings(
    demonstrations: Demonstrations, targets: Literal["action", "state"], lead: int
) -> ImitatorConfig:
    """Settings for these demonstrations; see `Imitator.from_demonstrations`."""
    _check(demonstrations, targets, lead)
    scaling = noise_scaling([shown.percepts for shown in demonstrations])
    fps, dimensions = demonstrations.fps, len(scaling.scale)
    attention = SOFMConfig.paper(
        dimensions,
        scale=scaling.scale,
        novelty_threshold=min(NOVELTY_THRESHOLD, math.exp(-RADIUS * scaling.noise)),
        winner_tau=max(1.0, SETTLING * fps),
    )
    percepts, action = demonstrations.percept_features, demonstrations.action_names
    state = next(iter(percepts.values()))
    unusual = max(LEAST_UNUSUAL, UNUSUAL * scaling.noise)
    schemas = CompetingSchemasConfig(
        len(action) if targets == "action" else len(state),
        dimensions,
        same_schema_similarity=math.exp(-max(LEAST_ALIKE, ALIKE * scaling.noise)),
        lookahead_samples=max(1, round(SEEN_AFTER * fps)),
        recognition=RecognitionConfig(novel_above=1 - math.exp(-unusual)),
    )
    return ImitatorConfig(
        percepts=percepts,
        action=action,
        fps=fps,
        targets=targets,
        lead=lead,
        network=PACNetConfig(attention, schemas),
        forward_model=_forward_model(demonstrations.episodes, lead) if targets == "state" else None,
    )


def _check(demonstrations: Demonstrations, targets: str, lead: int) -> None:
    """Refuses what no settings suit."""
    if not demonstrations.percept_features:
        raise ValueError(
            f"expected percepts and actions of different features, got {demonstrations.action!r} "
            "for both"
        )
    longest = max((len(shown.state) for shown in demonstrations), default=0)
    if targets == "state" and not (is_integer(lead, 1) and lead < longest):
        raise ValueError(
            f"expected lead as a number of frames from 1 to {longest - 1}, less than the longest "
            f"demonstration has, got {lead!r}"
        )


def _forward_model(episodes: Sequence[Demonstration], lead: int) -> MLPForwardModelConfig:
    """A forward model that chooses among the kinds of actions that were shown."""
    actions = torch.cat([shown.action for shown in episodes])
    change = torch.cat([shown.state[lead:] - shown.state[:-lead] for shown in episodes])
    usual = change.double().square().mean().sqrt()
    return MLPForwardModelConfig(
        state_dimensions=change.shape[1],
        action_dimensions=actions.shape[1],
        candidates=_kinds(actions),
        steps=lead,
        abstain_below=INDIFFERENT * float(usual) if len(change) else 0.0,
    )


def _kinds(actions: Tensor) -> tuple[tuple[float, ...], ...]:
    """Actions `[T, U]` as a few that stand for all of them."""
    different = actions.double().unique(dim=0)
    if len(different) < 2:
        raise ValueError(
            f"expected actions that differ, for a forward model to choose from, got "
            f"{different.tolist()} in every frame"
        )
    if len(different) > CANDIDATES:
        generator = torch.Generator().manual_seed(0)
        different, _ = kmeans(actions.double(), CANDIDATES, generator)
    return tuple(tuple(action) for action in different.tolist())
