"""Episodes of Experiment 1: watching a demonstration, and imitating one while it is performed."""

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
from envs.physics import CONTROL_TIMESTEP
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES, PosturalImitationEnv, percept
from pacnet import NO_NODE, PACNet
from train.common.pool import share_out

FPS = round(1 / CONTROL_TIMESTEP)  # [1/s]
TASK = "drink a glass of beer"
PERCEPTS, TARGETS = len(STATE_NAMES) + len(GLASS_NAMES), len(JOINTS)  # dimensions

LEAD = 1  # [samples] from a percept to its target; makes up for the lag of the joints
SMOOTHING = 11  # [samples] window of the quadratic smoother of noisy perceived angles

_DEMONSTRATIONS, _RECALLS = 0, 1  # purposes for which seeds are drawn


@dataclass(frozen=True)
class Condition:
    """How a recall episode differs from the demonstrations.

    Attributes:
        pace: Of the demonstrator; 1.25 is 25 % faster.
        noise: Factor on the perceptual noise.
        behaviour: To demonstrate, one of `envs.behaviours.BEHAVIOURS`.
    """

    pace: float = 1.0
    noise: float = 1.0
    behaviour: str = "drink"


@dataclass(frozen=True, eq=False)
class RecallEpisode:
    """Record of one recall episode of T steps."""

    percepts: NDArray[np.float32]  # [T, 28]
    winners: NDArray[np.int64]  # [T], NO_NODE where the match was not good enough
    commanded: NDArray[np.bool_]  # [T], whether a target was recalled
    phases: NDArray[np.str_]  # [T] of the demonstration
    demonstrator_wrist: NDArray[np.float64]  # [T, 3] [m], own body frame
    imitator_wrist: NDArray[np.float64]  # [T, 3] [m], own body frame
    demonstrator_angles: NDArray[np.float64]  # [T, 11] [rad]
    imitator_angles: NDArray[np.float64]  # [T, 11] [rad]
    rim_to_mouth: float  # [m] at its nearest
    glass_from_place: float  # [m] at the end
    success: bool
    demonstrator_success: bool


def make_environment(condition: Condition, render: bool = False) -> PosturalImitationEnv:
    """Return the environment without gymnasium's wrappers."""
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
    """Return the seeds of a run's demonstrations."""
    return _seeds(seed, _DEMONSTRATIONS, count)


def recall_seeds(seed: int, count: int) -> list[int]:
    """Return the seeds of a run's recall episodes, distinct from its demonstrations'."""
    return _seeds(seed, _RECALLS, count)


def watch_demonstration(
    environment: PosturalImitationEnv,
    seed: int,
    mishap: str | None = None,
    *,
    offset: tuple[float, float] = (0.0, 0.0),
    at_sample: Callable[[], object] = lambda: None,
) -> NDArray[np.float32]:
    """Return the percepts `[T, 28]` of an imitator that rests and watches.

    Args:
        environment: To watch in.
        seed: Of the demonstration.
        mishap: What goes wrong in it, one of `envs.mishaps.MISHAPS`.
        offset: Of the glasses from their usual place [m], as of the environment's `reset`.
        at_sample: Called at each sample.
    """
    options = {"glass_offset": offset} | ({} if mishap is None else {"mishap": mishap})
    observation, _ = environment.reset(seed=seed, options=options)
    percepts, truncated = [percept(observation)], False
    at_sample()
    while not truncated:
        observation, _, _, truncated, _ = environment.step_to(environment.rest_posture)
        percepts.append(percept(observation))
        at_sample()
    return np.stack(percepts)


def motor_targets(percepts: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the joint-angle targets `[T, 11]` [rad] for the percepts of a demonstration.

    They are the perceived angles, smoothed and `LEAD` samples ahead; the last ones repeat.

    Args:
        percepts: Of the demonstration `[T, 28]`.
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
    """Recall one episode; without a target, the imitator holds the last one.

    Args:
        network: A trained one.
        environment: To act in.
        seed: Of the episode.
        after_step: Called after each step with its number.
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
    """Return the recall episodes of a checkpoint, in the order of their seeds, run on all cores.

    Each episode has its own seed, so the results do not depend on the number of cores.

    Args:
        checkpoint: Its folder.
        seeds: One for each episode.
        condition: Of all episodes.
        label: Of the progress bar.
    """
    return share_out(_Worker, (checkpoint, condition), seeds, label)


class _Worker:
    """Run episodes with a loaded checkpoint and an environment."""

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
