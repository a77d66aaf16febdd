"""Episodes of Experiment 1: watching one demonstration, and recalling one while it is performed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

import envs  # noqa: F401  # registers the environment
from envs.humanoid import JOINTS
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES, PosturalImitationEnv, percept
from pacnet import NO_NODE, PACNet
from train.common.pool import share_out

TASK = "drink a glass of beer"
PERCEPTS, TARGETS = len(STATE_NAMES) + len(GLASS_NAMES), len(JOINTS)  # dimensions of each

LEAD = 1  # [samples] a target lies ahead of its percept: what the imitator's joints lag behind
SMOOTHING = 11  # [samples] of the quadratic smoother of perceived angles: noise becomes jerk

_DEMONSTRATIONS, _RECALLS = 0, 1  # what seeds are drawn for


@dataclass(frozen=True)
class Condition:
    """What a recall episode is like, against how it was taught.

    Attributes:
        pace: of the demonstrator; 1.25 is 25 % faster.
        noise: factor on the perceptual noise.
        behaviour: that is demonstrated, of `envs.behaviours.BEHAVIOURS`.
    """

    pace: float = 1.0
    noise: float = 1.0
    behaviour: str = "drink"


@dataclass(frozen=True, eq=False)
class RecallEpisode:
    """What happened while the imitator recalled. T steps."""

    percepts: NDArray[np.float32]  # [T, 28]
    winners: NDArray[np.int64]  # [T], NO_NODE where the match was not good enough
    commanded: NDArray[np.bool_]  # [T]
    phases: NDArray[np.str_]  # [T] of the demonstration, when perceived
    demonstrator_wrist: NDArray[np.float64]  # [T, 3] [m], own body frame
    imitator_wrist: NDArray[np.float64]  # [T, 3] [m], own body frame
    demonstrator_angles: NDArray[np.float64]  # [T, 11] [rad]
    imitator_angles: NDArray[np.float64]  # [T, 11] [rad]
    rim_to_mouth: float  # [m] at its nearest
    glass_from_place: float  # [m] at the end
    success: bool
    demonstrator_success: bool


def make_environment(condition: Condition, render: bool = False) -> PosturalImitationEnv:
    """The environment itself, without gymnasium's wrappers."""
    environment = gymnasium.make(
        "pacnet/PosturalImitation-v0",
        render_mode="rgb_array" if render else None,
        pace=condition.pace,
        noise_scale=condition.noise,
        behaviour=condition.behaviour,
    ).unwrapped
    assert isinstance(environment, PosturalImitationEnv)
    return environment


def demonstration_seeds(seed: int, count: int) -> list[int]:
    """Seeds of a run's demonstrations."""
    return _seeds(seed, _DEMONSTRATIONS, count)


def recall_seeds(seed: int, count: int) -> list[int]:
    """Seeds of a run's recall episodes; never those of its demonstrations."""
    return _seeds(seed, _RECALLS, count)


def watch_demonstration(
    environment: PosturalImitationEnv, seed: int, mishap: str | None = None
) -> NDArray[np.float32]:
    """Percepts `[T, 28]` of an imitator that rests and watches.

    Args:
        environment: to watch in.
        seed: of the demonstration.
        mishap: what goes wrong in it, of `envs.mishaps.MISHAPS`.
    """
    options = {} if mishap is None else {"mishap": mishap}
    observation, _ = environment.reset(seed=seed, options=options)
    percepts = [percept(observation)]
    truncated = False
    while not truncated:
        observation, _, _, truncated, _ = environment.step_to(environment.rest_posture)
        percepts.append(percept(observation))
    return np.stack(percepts)


def motor_targets(percepts: NDArray[np.float32]) -> NDArray[np.float32]:
    """Joint-angle targets `[T, 11]` [rad] that go with the percepts `[T, 28]` of a demonstration.

    The perceived angles, smoothed, `LEAD` samples ahead; at the end the last ones stay.
    """
    angles = savgol_filter(percepts[:, : len(JOINTS)], SMOOTHING, polyorder=2, axis=0)
    ahead = np.minimum(np.arange(len(angles)) + LEAD, len(angles) - 1)
    return angles[ahead].astype(np.float32)


def recall_episode(
    network: PACNet,
    environment: PosturalImitationEnv,
    seed: int,
    after_step: Callable[[int], None] | None = None,
) -> RecallEpisode:
    """One episode: where nothing is commanded, the imitator holds its last target.

    Args:
        network: a taught one.
        environment: to act in.
        seed: of the episode.
        after_step: called after each step with its number.
    """
    network.reset()
    observation, info = environment.reset(seed=seed)
    target = environment.rest_posture
    steps: list[dict[str, Any]] = []
    truncated = False
    while not truncated:
        percepts, phase = percept(observation), info["phase"]
        decision = network.step(percepts)
        commanded = decision.target is not None
        if commanded:
            target = decision.target
        observation, _, _, truncated, info = environment.step_to(target)
        winner = NO_NODE if decision.is_novel else decision.winner
        seen = {"percepts": percepts, "phases": phase, "winners": winner}
        steps.append({**info, **seen, "commanded": commanded})
        if after_step is not None:
            after_step(len(steps))
    return _recall_episode(steps)


def recall_episodes(
    checkpoint: str | Path, seeds: Sequence[int], condition: Condition, label: str = "recalling"
) -> list[RecallEpisode]:
    """Recall episodes of a checkpoint, in the order of their seeds, on all cores.

    Every episode is drawn from its own seed, so the number of cores changes nothing.

    Args:
        checkpoint: folder.
        seeds: one an episode.
        condition: of all of them.
        label: of the progress bar.
    """
    return share_out(_Worker, (checkpoint, condition), seeds, label)


class _Worker:
    """A loaded checkpoint and an environment that run episode after episode."""

    def __init__(self, checkpoint: str | Path, condition: Condition) -> None:
        self.network = PACNet.from_pretrained(checkpoint).eval()
        self.environment = make_environment(condition)

    def run(self, seed: int) -> RecallEpisode:
        return recall_episode(self.network, self.environment, seed)


def _seeds(seed: int, purpose: int, count: int) -> list[int]:
    return np.random.SeedSequence([seed, purpose]).generate_state(count).tolist()


def _recall_episode(steps: list[dict[str, Any]]) -> RecallEpisode:
    def series(name: str) -> NDArray[Any]:
        return np.stack([step[name] for step in steps])

    last = steps[-1]
    return RecallEpisode(
        percepts=series("percepts"),
        winners=series("winners"),
        commanded=series("commanded"),
        phases=series("phases"),
        demonstrator_wrist=series("demonstrator_wrist"),
        imitator_wrist=series("imitator_wrist"),
        demonstrator_angles=series("demonstrator_angles"),
        imitator_angles=series("imitator_angles"),
        rim_to_mouth=float(series("rim_to_mouth").min()),
        glass_from_place=float(last["glass_from_place"]),
        success=bool(last["is_success"]),
        demonstrator_success=bool(last["demonstrator_success"]),
    )
