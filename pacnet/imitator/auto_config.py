"""Settings of an imitator, chosen from the demonstrations it is to learn.

Nothing in them depends on how often a second frames were recorded: numbers of frames are times, and
the scale is that of what was shown.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from pacnet.attention.config import SOFMConfig
from pacnet.core.validation import is_integer
from pacnet.datasets.demonstrations import Demonstrations, dimension_names
from pacnet.forward_models.config import MLPForwardModelConfig
from pacnet.forward_models.correction import find_position_targets
from pacnet.forward_models.kmeans import kmeans
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.points import PointsChoice, choose_points
from pacnet.imitator.scaling import choose_scaling

NOVELTY_THRESHOLD = 0.55  # activation under which the map grows
WINNER_TAU = 0.1  # [s] a winner is fully habituated after three times as long
MAX_CANDIDATES = 32  # actions that a forward model chooses from
MIN_SPREAD = 0.1  # of the candidates' outcomes, in shares of the mean change; below it abstains


def choose_settings(
    demonstrations: Demonstrations,
    targets: Literal["action", "state"],
    lead: int,
    budget: int | None,
    points: PointsChoice,
) -> ImitatorConfig:
    """Return settings for these demonstrations; see `Imitator.from_demonstrations`."""
    _check_features(demonstrations)
    episodes, demonstrations = demonstrations, demonstrations.continuous()
    percepts, fps = demonstrations.percept_features, demonstrations.fps
    if targets == "state":
        _check_targets(demonstrations, lead)
    shown = [one.percepts for one in demonstrations]
    scaling = choose_scaling(shown, percepts, fps)
    follows, after = _follows(demonstrations, targets, lead)
    return ImitatorConfig(
        percepts=percepts,
        action=demonstrations.action_names,
        fps=fps,
        targets=targets,
        lead=lead,
        scaling=scaling,
        attention=_attention(shown, scaling.scale, fps),
        follows=follows,
        follows_after=after,
        budget=budget,
        forward_model=_forward_model(demonstrations, lead) if targets == "state" else None,
        state=demonstrations.state_features,
        action_features=demonstrations.action_features,
        points=choose_points(points, episodes),
    )


def _attention(shown: list[Tensor], scale: tuple[float, ...], fps: float) -> SOFMConfig:
    """Return settings of the map, whose percepts are a quadratic mean of 1 from their mean."""
    factors = torch.tensor(scale, dtype=torch.float64)
    spread = (torch.cat(shown).double() * factors).std(dim=0, correction=0)
    factors /= torch.linalg.vector_norm(spread)
    return SOFMConfig.paper(
        len(scale),
        scale=tuple(factors.tolist()),
        novelty_threshold=NOVELTY_THRESHOLD,
        winner_tau=max(1.0, WINNER_TAU * fps),
    )


def _follows(
    demonstrations: Demonstrations, targets: Literal["action", "state"], lead: int
) -> tuple[tuple[int, ...], int]:
    """Return which targets are places of the state, and by how many frames they lie ahead."""
    features = demonstrations.percept_features
    names = dimension_names({name: features[name] for name in demonstrations.state_features})
    if targets == "state":
        return tuple(range(len(names))), lead
    states = [one.state for one in demonstrations]
    actions = [one.action for one in demonstrations]
    return find_position_targets(
        states, actions, names, demonstrations.action_names, demonstrations.fps
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
