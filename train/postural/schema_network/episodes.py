"""Episodes of the paper's Figure 2: three behaviours, segmented into 13 schemas, and imitated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from envs.postural_imitation import PosturalImitationEnv, percept
from pacnet import NO_NODE, PACNet
from pacnet.competition.winner_take_all import Competition, CompetitionConfig
from pacnet.network.config import SchemaNetworkConfig
from pacnet.network.schema_network import SchemaNetwork
from train.common.pool import share_out
from train.postural.episodes import (
    PERCEPTS,
    SMOOTHING,
    TARGETS,
    Condition,
    make_environment,
    motor_targets,
)
from train.postural.learning import SCALE
from train.postural.scores import winners_of

# Behaviour -> its schemas, numbered from 1 as in the paper.
SCHEMAS = {"drink": (1, 2, 3, 4, 5), "toast": (1, 6, 7, 8, 9), "move": (10, 11, 12, 13)}
PARTS = 4  # of equal duration, after the shared part of a behaviour

WIDTH = 0.5  # [scaled units]; noise alone is about 0.07 from the nearest percept of a sequence
THRESHOLD = 0.5  # confidence at a distance of 0.35
MARGIN = 0.1  # noise seldom makes equal confidences differ by more

SCHEMA_NETWORK, PACNET = "schema network", "PACNet"
SCHEMA_NETWORK_HELD, PACNET_HELD = "schema network, hysteresis", "PACNet, hysteresis"
BY_ATTENTION = "schema network by attention"
SYSTEMS = (SCHEMA_NETWORK, SCHEMA_NETWORK_HELD, BY_ATTENTION, PACNET, PACNET_HELD)


@dataclass(frozen=True, eq=False)
class Shown:
    """A demonstration of T samples, as the imitator perceives it."""

    percepts: NDArray[np.float32]  # [T, 28]
    phases: tuple[str, ...]  # [T]


@dataclass(frozen=True, eq=False)
class Episode:
    """One behaviour of T samples, shown once to every system."""

    behaviour: str
    shown: Shown
    winners: Mapping[str, NDArray[np.int64]]  # system -> [T], a schema from 1 or a node from 0
    success: Mapping[str, bool]  # of the systems that acted


def watch(environment: PosturalImitationEnv, seed: int) -> Shown:
    """Return a demonstration, watched by a resting imitator."""
    shown, _ = _run_episode(environment, seed, lambda _: environment.rest_posture)
    return shown


def make_schema_network(shown: Mapping[str, Shown]) -> SchemaNetwork:
    """Return 13 schemas, segmented by hand from one demonstration of each behaviour.

    Schema 1 is the drink up to the grasp, the approach that drink and toast share. The rest of
    both, and the whole move, consist of `PARTS` parts of equal duration. The percepts are smoothed
    like the targets: schemas made by hand are clean.

    Args:
        shown: Behaviour -> its demonstration.
    """
    network = empty_schema_network()
    grasp = {name: shown[name].phases.index("grasp") for name in ("drink", "toast")}
    cuts = [("drink", (0, grasp["drink"]))]
    for name, start in (*grasp.items(), ("move", 0)):
        bounds = np.linspace(start, len(shown[name].phases), PARTS + 1).round().astype(int)
        cuts += [(name, (first, last)) for first, last in pairwise(bounds.tolist())]
    for name, bounds in cuts:
        percepts, part = shown[name].percepts, slice(*bounds)
        sequences = smooth(percepts)[part], motor_targets(percepts)[part]
        network.add_schema(*map(torch.from_numpy, sequences))
    return network


def empty_schema_network() -> SchemaNetwork:
    """Return a schema network for this scene, without any schema."""
    rules = CompetitionConfig(THRESHOLD)
    return SchemaNetwork(SchemaNetworkConfig(PERCEPTS, TARGETS, SCALE, WIDTH, rules))


def smooth(percepts: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return percepts `[T, 28]` smoothed over time, like the targets."""
    return savgol_filter(percepts, SMOOTHING, polyorder=2, axis=0).astype(np.float32)


def with_margin(network: SchemaNetwork, margin: float) -> SchemaNetwork:
    """Return the same schemas with another margin of their competition."""
    rules = replace(network.config.competition, margin=margin)
    other = SchemaNetwork(replace(network.config, competition=rules))
    other.load_state_dict(network.state_dict())
    return other


def held_out_episodes(
    checkpoints: Path, seeds: Mapping[str, Sequence[int]], label: str = "imitating"
) -> list[Episode]:
    """Return new episodes of each behaviour, shown to all systems, run on all cores.

    Each episode has its own seed, so the results do not depend on the number of cores.

    Args:
        checkpoints: Folder of the checkpoints `schema_network`, `by_attention` and `pacnet`.
        seeds: Behaviour -> seeds, one for each episode.
        label: Of the progress bar.

    Returns:
        The episodes, in the order of their behaviours and seeds.
    """
    tasks = [(behaviour, seed) for behaviour in seeds for seed in seeds[behaviour]]
    return share_out(_Worker, (checkpoints,), tasks, label)


def _run_episode(
    environment: PosturalImitationEnv, seed: int, choose: Callable[[NDArray], NDArray]
) -> tuple[Shown, bool]:
    """Run one episode in which `choose` gives the imitator's target for each percept.

    Returns:
        What was shown, and whether the imitator completed the task.
    """
    observation, info = environment.reset(seed=seed)
    percepts, phases, truncated = [], [], False
    while not truncated:
        percepts.append(percept(observation))
        phases.append(info["phase"])
        observation, _, _, truncated, info = environment.step_to(choose(percepts[-1]))
    return Shown(np.stack(percepts), tuple(phases)), bool(info["is_success"])


def _imitate(
    network: SchemaNetwork | PACNet, environment: PosturalImitationEnv, seed: int
) -> tuple[Shown, bool]:
    """Run one episode with the winner's targets; without a target the last one is held."""
    network.reset()
    target = environment.rest_posture

    def choose(seen: NDArray[np.float32]) -> NDArray[np.float32]:
        nonlocal target
        decision = network.recall(torch.from_numpy(seen)[None])
        if decision.has_target.item():
            target = decision.target[0].numpy()
        return target

    return _run_episode(environment, seed, choose)


class _Worker:
    """Run episodes with the loaded systems and an environment for each behaviour."""

    def __init__(self, checkpoints: Path) -> None:
        self.schemas = SchemaNetwork.from_pretrained(checkpoints / "schema_network")
        self.held = with_margin(self.schemas, MARGIN)
        self.by_attention = SchemaNetwork.from_pretrained(checkpoints / "by_attention")
        self.pacnet = PACNet.from_pretrained(checkpoints / "pacnet").eval()
        self.environments = {
            behaviour: make_environment(Condition(behaviour=behaviour)) for behaviour in SCHEMAS
        }

    def run(self, task: tuple[str, int]) -> Episode:
        behaviour, seed = task
        environment = self.environments[behaviour]
        # The imitator's own movement changes its percepts only by rounding errors.
        acting = {
            SCHEMA_NETWORK: self.schemas,
            BY_ATTENTION: self.by_attention,
            PACNET: self.pacnet,
        }
        done = {name: _imitate(network, environment, seed) for name, network in acting.items()}
        shown = done[SCHEMA_NETWORK][0]
        winners = {
            SCHEMA_NETWORK: schemas_winning(self.schemas, shown.percepts),
            SCHEMA_NETWORK_HELD: schemas_winning(self.held, shown.percepts),
            BY_ATTENTION: schemas_winning(self.by_attention, shown.percepts),
            PACNET: winners_of(self.pacnet, shown.percepts),
            PACNET_HELD: held_winners(self.pacnet, shown.percepts),
        }
        success = {name: completed for name, (_, completed) in done.items()}
        return Episode(behaviour, shown, winners, success)


def schemas_winning(network: SchemaNetwork, percepts: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the winning schemas `[T]`, numbered from 1; `NO_NODE` where none is active."""
    network.reset()
    winner = network.recall(torch.from_numpy(percepts)).winner
    return torch.where(winner == NO_NODE, NO_NODE, winner + 1).numpy()


def held_winners(network: PACNet, percepts: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the winning nodes `[T]` of a competition of activations with hysteresis."""
    scaled = network.sofm.normalize(torch.from_numpy(percepts))
    activations = torch.exp(-torch.cdist(scaled, network.sofm.nodes.live("prototype")))
    rules = CompetitionConfig(network.config.attention.novelty_threshold, MARGIN)
    return Competition(rules).over_time(activations).numpy()
