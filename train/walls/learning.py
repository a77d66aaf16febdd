"""What Experiment 2 records, and what it learns from following: a map with schemas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from envs.arena_scene import CONTROL_TIMESTEP
from envs.khepera import INFRARED_NAMES
from envs.wall_behaviours import DRIVING, RESTING
from pacnet import (
    ForwardModel,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    SOFMConfig,
    targets_ahead,
)
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Recorder
from train.common.expected_findings import expect_findings
from train.common.learning_log import LearningLog
from train.walls.episodes import TAUGHT_SIDES, Transitions, follow, following_seeds, wander

FPS = round(1 / CONTROL_TIMESTEP)  # [1/s]
WHEEL_NAMES = ("left_wheel.vel", "right_wheel.vel")  # as LeRobot names speeds
FEATURES = {"observation.state": INFRARED_NAMES, "action": WHEEL_NAMES}
ROBOT = "khepera"

TRANSITIONS = 5000  # [steps] of wandering
WANDERING_STEPS = 500  # at most in an episode of the dataset
WANDERING_TASK = "wander around and turn away from walls"
EPISODES_A_SIDE, EPISODE_STEPS = 8, 375  # of following
LEAD = 5  # [steps] from a percept to its target; the forward model holds an action as long
NOVELTY_THRESHOLD = 0.6
NEAREST_CUES = 50  # over which a target is averaged
EPISODE = 0  # number of the only learning episode
CHUNK = 50  # samples learned between two points of the learning curves

# A checker reports readings that jump and return within 3 steps as glitches.
JUMPS, WHY_THEY_JUMP = "episodes.spikes*", (
    "simulated infra-red readings, which without their noise jump the same way: within a few steps "
    "of 0.1 s the robot turns to a wall or away from it, or a ray passes the edge of a wall or of "
    "another robot"
)  # fmt: skip


class Episode(NamedTuple):
    """One episode of following."""

    percepts: Tensor  # [T, 6]
    actions: Tensor  # [T, 2]
    side: int  # index into TAUGHT_SIDES


def task_of(side: str) -> str:
    """Return the task of a following episode in the dataset."""
    return f"follow the {side} wall"


def record_wandering(folder: Path, arena: str | int, seed: int, steps: int) -> None:
    """Wander, and write the walk into a LeRobot dataset as episodes of similar length."""
    episodes = math.ceil(steps / WANDERING_STEPS)
    with Recorder(folder, FPS, FEATURES, ROBOT) as recorder:
        walk = wander(arena, steps, seed)
        for part in zip(*(np.array_split(rows, episodes) for rows in walk), strict=True):
            recorder.save_episode(WANDERING_TASK, _frames(Transitions(*part)))
    expect_findings(folder, JUMPS, WHY_THEY_JUMP)


def record_following(folder: Path, arena: str | int, seed: int, *, rests: bool = False) -> None:
    """Follow the teacher along left walls, then right ones, into a LeRobot dataset.

    Args:
        folder: Of the dataset.
        arena: "paper" or a seed.
        seed: Of the episodes.
        rests: See `follow_both_sides`.
    """
    total = len(TAUGHT_SIDES) * EPISODES_A_SIDE * _episode_steps(rests)
    with (
        Recorder(folder, FPS, FEATURES, ROBOT) as recorder,
        tqdm(total=total, desc="following", unit="step") as progress,
    ):
        for side, followed in _follow_both_sides(arena, seed, rests, progress.update):
            recorder.save_episode(task_of(TAUGHT_SIDES[side]), _frames(followed))
    expect_findings(folder, JUMPS, WHY_THEY_JUMP)


def load_episodes(folder: Path) -> list[Episode]:
    """Return the episodes that `record_following` wrote."""
    side_of = {task_of(side): index for index, side in enumerate(TAUGHT_SIDES)}
    return [
        Episode(episode.percepts, episode.action, side_of[episode.task])
        for episode in _load(folder)
    ]


def follow_both_sides(arena: str | int, seed: int, *, rests: bool = False) -> list[Episode]:
    """Return the same episodes without writing a dataset.

    Args:
        arena: "paper" or a seed.
        seed: Of the episodes.
        rests: Whether the teacher stops for a minute now and then. Episodes are then longer: the
            robots drive for as long as without rests.
    """
    return [
        Episode(torch.from_numpy(followed.percepts), torch.from_numpy(followed.actions), side)
        for side, followed in _follow_both_sides(arena, seed, rests)
    ]


def make_network(forward_model: ForwardModel, targets: int = len(INFRARED_NAMES)) -> PACNet:
    """Return an untrained network for this experiment.

    Args:
        forward_model: To act with.
        targets: Dimensions of a target: readings, or wheel speeds.
    """
    percepts = len(INFRARED_NAMES)
    attention = SOFMConfig.paper(percepts, novelty_threshold=NOVELTY_THRESHOLD)
    schemas = MotorSchemasConfig(targets, percepts, nearest_cues=NEAREST_CUES)
    return PACNet(PACNetConfig(attention, schemas), forward_model)


def teach(
    network: PACNet,
    episodes: Sequence[Episode],
    log: LearningLog | None = None,
    leave_bar: bool = True,
) -> None:
    """Let the network observe all episodes.

    All episodes count as one learning episode: by the paper's third rule a new one clears a node's
    targets when the node wins again, and a robot that follows a right wall sometimes sees a left
    one from afar.

    Args:
        network: To teach; in eval mode afterwards.
        episodes: Of following.
        log: Of the learning.
        leave_bar: Whether to keep the full progress bar.
    """
    total = sum(len(episode.percepts) for episode in episodes)
    with tqdm(total=total, desc="learning", unit="sample", leave=leave_bar) as progress:
        for episode in episodes:
            targets = targets_ahead(episode.percepts, LEAD)
            for seen, aim in zip(episode.percepts.split(CHUNK), targets.split(CHUNK), strict=True):
                observed = network.observe(seen, aim, EPISODE)
                if log is not None:
                    log.observed(network.sofm, observed)
                progress.update(len(seen))
    network.eval()


def frames(episodes: Sequence[Episode]) -> tuple[Tensor, Tensor]:
    """Return cues and targets `[N, 6]` of everything that was followed."""
    targets = [targets_ahead(episode.percepts, LEAD) for episode in episodes]
    return torch.cat([episode.percepts for episode in episodes]), torch.cat(targets)


def load_wandering(folder: Path) -> Transitions:
    """Return the whole walk that `record_wandering` wrote."""
    episodes = list(_load(folder))
    percepts = torch.cat([episode.percepts for episode in episodes])
    actions = torch.cat([episode.action for episode in episodes])
    return Transitions(percepts.numpy(), actions.numpy())


def _load(folder: Path) -> Demonstrations:
    return load_demonstrations(folder, environment_state=None)


def _follow_both_sides(
    arena: str | int, seed: int, rests: bool, after_step: Callable[[], object] | None = None
) -> Iterator[tuple[int, Transitions]]:
    """Yield each episode with the index of its side."""
    seeds = following_seeds(seed, len(TAUGHT_SIDES) * EPISODES_A_SIDE)
    for number, episode_seed in enumerate(seeds):
        side = number // EPISODES_A_SIDE
        steps = _episode_steps(rests)
        yield (
            side,
            follow(arena, TAUGHT_SIDES[side], episode_seed, steps, after_step, rests=rests),
        )


def _episode_steps(rests: bool) -> int:
    """Return the steps of an episode, with the time that the teacher rests."""
    return EPISODE_STEPS + rests * RESTING * (EPISODE_STEPS // DRIVING)


def _frames(transitions: Transitions) -> dict[str, np.ndarray]:
    return {"observation.state": transitions.percepts, "action": transitions.actions}
