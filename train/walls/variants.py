"""What one replicate of Experiment 2 learned, and variants of it that each lack one part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pacnet import (
    Command,
    ForwardModel,
    MLPForwardModel,
    PACNet,
    TransitionMatrix,
    TransitionMatrixConfig,
)
from train.walls.episodes import Transitions, wander
from train.walls.forward_model import changes, fit, make_forward_model, walks_of
from train.walls.learning import (
    EPISODE,
    TRANSITIONS,
    Episode,
    follow_both_sides,
    make_network,
    teach,
)

FREE_SPEEDS = (0.0, 0.03, 0.06, 0.07)  # [m/s] of the candidates where the speed is free


@dataclass(frozen=True, eq=False)
class Learned:
    """What one replicate learned, and from what.

    Attributes:
        seed: Of the replicate.
        arena: Where it learned.
        wandering: To which the forward model was fitted, with the episodes.
        episodes: Of following.
        network: Trained, with the forward model.
    """

    seed: int
    arena: str | int
    wandering: Transitions
    episodes: Sequence[Episode]
    network: PACNet


class Repeat(nn.Module):
    """Return the target as the action, in place of a forward model."""

    action_dimensions = 2

    def command(self, states: Tensor, targets: Tensor) -> Command:
        """Return the targets themselves `[B, U]`."""
        return Command(targets, torch.ones(len(states), dtype=torch.bool))

    def reset(self) -> None:
        """Do nothing."""


def learn(seed: int, arena: str | int) -> Learned:
    """Wander, fit, follow and observe, without writing anything."""
    wandering = wander(arena, TRANSITIONS, seed)
    episodes = follow_both_sides(arena, seed)
    model = make_forward_model(seed)
    fit(model, walks_of(wandering, episodes), seed)
    network = make_network(model)
    teach(network, episodes)
    return Learned(seed, arena, wandering, episodes, network)


def with_forward_model(learned: Learned, forward_model: ForwardModel) -> PACNet:
    """Return the trained network with another forward model."""
    network = deepcopy(learned.network)
    network.forward_model = forward_model
    return network


def _with_targets(learned: Learned, change: Callable[[Tensor], Tensor]) -> PACNet:
    """Return the trained network with changed targets `[P, 6]`."""
    network = deepcopy(learned.network)
    every = [network.schemas.targets(node) for node in range(len(network.schemas))]  # views
    changed = change(torch.cat(every)).split([len(targets) for targets in every])
    for targets, others in zip(every, changed, strict=True):
        targets.copy_(others)
    return network


def constant_target(learned: Learned) -> PACNet:
    """Return the network with all targets replaced by their mean."""
    return _with_targets(learned, lambda targets: targets.mean(dim=0).expand_as(targets))


def shuffled_targets(learned: Learned) -> PACNet:
    """Return the network with each node's targets drawn from those of another node."""
    network = deepcopy(learned.network)
    own, schemas = learned.network.schemas, network.schemas
    generator = torch.Generator().manual_seed(learned.seed)
    nodes = own.lengths.nonzero().flatten()  # that have any
    nodes = nodes[torch.randperm(len(nodes), generator=generator)]
    for node, other in zip(nodes.tolist(), nodes.roll(1).tolist(), strict=True):
        theirs, mine = own.targets(other), schemas.targets(node)  # views
        mine.copy_(theirs[torch.randint(len(theirs), (len(mine),), generator=generator)])
    return network


def mean_action(learned: Learned) -> PACNet:
    """Return a network that repeats each node's mean action of the learner."""
    network = make_network(Repeat(), targets=2)
    for episode in learned.episodes:
        network.observe(episode.percepts, episode.actions, EPISODE)
    for node in range(len(network.schemas)):
        actions = network.schemas.targets(node)  # a view
        actions.copy_(actions.mean(dim=0).expand_as(actions))
    return network.eval()


def untrained(learned: Learned) -> MLPForwardModel:
    """Return a forward model with random weights."""
    return make_forward_model(learned.seed)


def speed_free(learned: Learned) -> MLPForwardModel:
    """Return the fitted forward model, choosing the speed too."""
    model = make_forward_model(learned.seed, FREE_SPEEDS)
    model.load_state_dict(fitted_model(learned).state_dict())
    return model


def transition_matrix(learned: Learned) -> TransitionMatrix:
    """Return the paper's forward model, fitted to the same transitions.

    It has seven of the candidates, one of them straight ahead; with more, each would have too few
    samples.
    """
    config = fitted_model(learned).config
    model = TransitionMatrix(
        TransitionMatrixConfig(
            config.state_dimensions,
            config.action_dimensions,
            config.candidates[1::3],
            steps=config.steps,
            abstain_below=config.abstain_below,
        )
    )
    model.fit(*changes(walks_of(learned.wandering, learned.episodes)), seed=learned.seed)
    return model


def fitted_model(learned: Learned) -> MLPForwardModel:
    """Return the forward model of what was learned."""
    model = learned.network.forward_model
    assert isinstance(model, MLPForwardModel)
    return model
