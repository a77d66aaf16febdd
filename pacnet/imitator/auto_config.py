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
from pacnet.forward_models.correction import NO_PLACE, find_position_targets
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.body import choose_body_frames
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.forward_model import NO_MODEL, choose_forward_model
from pacnet.imitator.frames import choose_frames
from pacnet.imitator.points import PointsChoice, choose_points
from pacnet.imitator.scaling import Scaling, choose_scaling
from pacnet.schemas.frames import FramesConfig
from pacnet.vision.cameras import Cameras

NOVELTY_THRESHOLD = 0.55  # activation under which the map grows
WINNER_TAU = 0.1  # [s] a winner is fully habituated after three times as long


def choose_settings(
    demonstrations: Demonstrations,
    points: PointsChoice,
    cameras: Cameras | None,
    *,
    targets: Literal["action", "state"],
    lead: int,
    budget: int | None,
    body: KinematicModel | None,
) -> ImitatorConfig:
    """Return settings for these demonstrations; see `Imitator.from_demonstrations`."""
    _check_features(demonstrations)
    _check_percepts(demonstrations)
    episodes, demonstrations = demonstrations, demonstrations.continuous()
    percepts, fps = demonstrations.percept_features, demonstrations.fps
    if targets == "state":
        _check_targets(demonstrations, lead)
    shown = [one.percepts for one in demonstrations]
    scaling = choose_scaling(shown, percepts, fps)
    names = _state_names(demonstrations)
    follows, after = find_position_targets(
        [one.state for one in demonstrations],
        [one.action for one in demonstrations],
        names,
        demonstrations.action_names,
        fps,
    )
    chosen = NO_MODEL
    if targets == "state":
        chosen = choose_forward_model(demonstrations.episodes, follows, lead)
        follows, after = (*range(len(names)), *[NO_PLACE] * len(chosen.still_actions)), lead
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
        forward_model=chosen.config,
        explained=chosen.explained,
        still_actions=chosen.still_actions,
        state=demonstrations.state_features,
        action_features=demonstrations.action_features,
        frames=_frames(points, body, episodes, scaling, targets),
        cameras=None if cameras is None else cameras.config,
    )


def _frames(
    choice: PointsChoice,
    body: KinematicModel | None,
    demonstrations: Demonstrations,
    scaling: Scaling,
    targets: Literal["action", "state"],
) -> FramesConfig | None:
    """Return the settings of frames of reference; None without points, or where they are no use."""
    given = body is not None or (choice is not None and choice != "auto")
    if targets == "state":
        if given:
            what = "points" if body is None else "a body"
            raise ValueError(f"expected {what} with targets of 'action', got targets of 'state'")
        return None
    if body is not None:
        return choose_body_frames(body, choice, demonstrations.continuous(), scaling.scale)
    points = choose_points(choice, demonstrations)
    if points is None:
        return None
    return choose_frames(points, demonstrations.continuous(), scaling.scale, given)


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


def _state_names(demonstrations: Demonstrations) -> tuple[str, ...]:
    """Return names of the state's dimensions, as if there were no other features."""
    features = demonstrations.percept_features
    return dimension_names({name: features[name] for name in demonstrations.state_features})


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


def _check_percepts(demonstrations: Demonstrations) -> None:
    """Raise a ValueError for an episode without frames, or one that is not finite."""
    names = dimension_names(demonstrations.percept_features)
    for shown in demonstrations:
        percepts, episode = shown.percepts, f"episode {shown.episode}"
        if len(percepts) == 0:
            raise ValueError(f"{episode}: expected one or more frames, got none")
        columns = (~percepts.isfinite()).any(dim=0).nonzero().flatten().tolist()
        if columns:
            values = percepts[:, columns[0]]
            got = values[~values.isfinite()][0].item()
            raise ValueError(f"{episode}: expected a finite {names[columns[0]]!r}, got {got}")


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
