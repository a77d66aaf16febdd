"""What Experiment 2 learns: a forward model from wandering, a map with schemas from following."""

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
from envs.khepera import INFRARED_NAMES, wheel_speeds
from envs.wall_behaviours import CRUISE, MAX_TURN
from pacnet import (
    ForwardModel,
    MLPForwardModel,
    MLPForwardModelConfig,
    MotorSchemasConfig,
    PACNet,
    PACNetConfig,
    SOFMConfig,
    targets_ahead,
)
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.forward_models.fitting import MAX_EPOCHS, FitReport
from train.common.expected_findings import expect_findings
from train.common.learning_log import LearningLog
from train.walls.episodes import TAUGHT_SIDES, Transitions, follow, following_seeds, shares, wander

FPS = round(1 / CONTROL_TIMESTEP)  # [1/s]
WHEEL_NAMES = ("left_wheel.vel", "right_wheel.vel")  # as LeRobot names speeds
FEATURES = {"observation.state": INFRARED_NAMES, "action": WHEEL_NAMES}
ROBOT = "khepera"

TRANSITIONS = 5000  # [steps] of wandering
WANDERING_STEPS = 500  # at most in an episode of the dataset
WANDERING_TASK = "wander around and turn away from walls"
EPISODES_A_SIDE, EPISODE_STEPS = 4, 750  # of following
LEAD = 3  # [steps] that a target lies ahead, and for which the forward model holds an action
NOVELTY_THRESHOLD = 0.6
NEAREST_CUES = 50  # over which a target is averaged
ABSTAIN_BELOW = 0.02  # spread of the predicted readings under which actions are all the same
TURNS = np.linspace(-MAX_TURN, MAX_TURN, 21)  # [rad/s] of the candidate actions
LESSON = 0  # number of the one learning episode
CHUNK = 50  # samples learned between two points of the learning curves

# A checker takes readings that jump and come back within 3 steps for glitches.
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
    """What a following episode is called in the dataset."""
    return f"follow the {side} wall"


def record_wandering(folder: Path, arena: str | int, seed: int, steps: int) -> None:
    """Wanders, and writes the walk into a LeRobot dataset, cut into episodes of like length."""
    episodes = math.ceil(steps / WANDERING_STEPS)
    with Recorder(folder, FPS, FEATURES, ROBOT) as recorder:
        walk = wander(arena, steps, seed)
        for part in zip(*(np.array_split(rows, episodes) for rows in walk), strict=True):
            recorder.save_episode(WANDERING_TASK, _frames(Transitions(*part)))
    expect_findings(folder, JUMPS, WHY_THEY_JUMP)


def record_following(folder: Path, arena: str | int, seed: int) -> None:
    """Follows the teacher along left walls, then along right ones, into a LeRobot dataset."""
    total = len(TAUGHT_SIDES) * EPISODES_A_SIDE * EPISODE_STEPS
    with (
        Recorder(folder, FPS, FEATURES, ROBOT) as recorder,
        tqdm(total=total, desc="following", unit="step") as progress,
    ):
        for side, followed in _follow_both_sides(arena, seed, progress.update):
            recorder.save_episode(task_of(TAUGHT_SIDES[side]), _frames(followed))
    expect_findings(folder, JUMPS, WHY_THEY_JUMP)


def load_episodes(folder: Path) -> list[Episode]:
    """The episodes that `record_following` wrote."""
    side_of = {task_of(side): index for index, side in enumerate(TAUGHT_SIDES)}
    return [
        Episode(episode.percepts, episode.action, side_of[episode.task])
        for episode in _load(folder)
    ]


def follow_both_sides(arena: str | int, seed: int) -> list[Episode]:
    """The same episodes without a dataset."""
    return [
        Episode(*map(torch.from_numpy, followed), side)
        for side, followed in _follow_both_sides(arena, seed)
    ]


def candidate_actions(speeds: Sequence[float] = (CRUISE,)) -> tuple[tuple[float, ...], ...]:
    """Every turn at every speed [m/s], as actions of the environment."""
    wheels = [wheel_speeds(speed, turn) for speed in speeds for turn in TURNS]
    return tuple(tuple(shares(pair).tolist()) for pair in wheels)


def make_forward_model(seed: int, speeds: Sequence[float] = (CRUISE,)) -> MLPForwardModel:
    """An unfitted forward model for this robot, its weights drawn from the seed."""
    config = MLPForwardModelConfig(
        state_dimensions=len(INFRARED_NAMES),
        action_dimensions=len(WHEEL_NAMES),
        candidates=candidate_actions(speeds),
        steps=LEAD,
        abstain_below=ABSTAIN_BELOW,
    )
    return MLPForwardModel(config, seed=seed)


def fit(model: MLPForwardModel, wandering: Transitions, seed: int) -> tuple[FitReport, Tensor]:
    """Fits a forward model to wandering, and to its mirror image, for the body has two like sides.

    Returns:
        The report, and training and validation loss after each epoch `[E, 2]`.
    """
    percepts, actions = (torch.from_numpy(rows) for rows in wandering)
    transitions = [
        torch.cat([rows, rows.flip(1)]) for rows in (percepts[:-1], actions[:-1], percepts[1:])
    ]
    losses = []
    with tqdm(total=MAX_EPOCHS, desc="fitting", unit="epoch") as progress:

        def note(_: int, train_loss: float, validation_loss: float) -> None:
            losses.append((train_loss, validation_loss))
            progress.update()

        report = model.fit(*transitions, seed=seed, progress=note)
        progress.total = progress.n  # it stopped early: that is all there was to do
    return report, torch.tensor(losses)


def make_network(forward_model: ForwardModel, targets: int = len(INFRARED_NAMES)) -> PACNet:
    """An from_demonstrations network for this experiment.

    Args:
        forward_model: to act with.
        targets: length of a target: readings, or wheel speeds.
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
    """The learning phase.

    All that was followed is one learning episode. By the paper's third rule a new one clears what
    a node holds when the node wins again, and a left wall is seen now and then, from afar, by a
    robot that follows a right one.

    Args:
        network: to teach; in eval mode afterwards.
        episodes: of following.
        log: of the learning.
        leave_bar: whether the progress bar stays when it is full.
    """
    total = sum(len(episode.percepts) for episode in episodes)
    with tqdm(total=total, desc="learning", unit="sample", leave=leave_bar) as progress:
        for episode in episodes:
            targets = targets_ahead(episode.percepts, LEAD)
            for seen, aim in zip(episode.percepts.split(CHUNK), targets.split(CHUNK), strict=True):
                observed = network.observe(seen, aim, LESSON)
                if log is not None:
                    log.observed(network.sofm, observed)
                progress.update(len(seen))
    network.eval()


def load_wandering(folder: Path) -> Transitions:
    """The walk that `record_wandering` wrote, whole again."""
    episodes = list(_load(folder))
    percepts = torch.cat([episode.percepts for episode in episodes])
    actions = torch.cat([episode.action for episode in episodes])
    return Transitions(percepts.numpy(), actions.numpy())


def _load(folder: Path) -> Demonstrations:
    return load_demonstrations(folder, environment_state=None)


def _follow_both_sides(
    arena: str | int, seed: int, after_step: Callable[[], object] | None = None
) -> Iterator[tuple[int, Transitions]]:
    """Each episode with the index of its side."""
    seeds = following_seeds(seed, len(TAUGHT_SIDES) * EPISODES_A_SIDE)
    for number, episode_seed in enumerate(seeds):
        side = number // EPISODES_A_SIDE
        yield side, follow(arena, TAUGHT_SIDES[side], episode_seed, EPISODE_STEPS, after_step)


def _frames(transitions: Transitions) -> dict[str, np.ndarray]:
    return {"observation.state": transitions.percepts, "action": transitions.actions}
