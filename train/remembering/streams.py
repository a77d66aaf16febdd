"""What is shown to a learner whose memory is bounded: drinks, with rests, noise or a rare toast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from envs.humanoid import JOINTS
from envs.perception import noise_std
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from train.postural.behaviours.episodes import TASKS
from train.postural.episodes import (
    FPS,
    PERCEPTS,
    Condition,
    demonstration_seeds,
    make_environment,
    motor_targets,
    watch_demonstration,
)

FEATURES = {
    "observation.state": STATE_NAMES,
    "observation.environment_state": GLASS_NAMES,
    "action": JOINTS,
}
DRINK, TOAST = "drink", "toast"
_BEGINNING = 10  # samples of a demonstration in which nothing moves yet
_RESTING = 5  # purpose for which seeds are drawn


@dataclass(frozen=True)
class Stream:
    """A kind of stream of demonstrations.

    Attributes:
        shown: The behaviours, in order.
        rest: For how long the demonstrator rests before each of them [s].
        noise: Factor on the perceptual noise.
        wanted: What a learner is to do afterwards.
    """

    shown: tuple[str, ...] = (DRINK,) * 8
    rest: float = 0.0
    noise: float = 1.0
    wanted: str = DRINK


PLAIN, RESTS, RARE, NOISY = "plain", "rests of a minute", "one toast in 21", "noise × 3"
STREAMS = {
    PLAIN: Stream(),
    RESTS: Stream(rest=60.0),
    RARE: Stream((*(DRINK,) * 10, TOAST, *(DRINK,) * 10), wanted=TOAST),
    NOISY: Stream(noise=3.0),
}


def show(stream: Stream, seed: int) -> Demonstrations:
    """Return what a resting imitator perceives of a stream, and the joint angles to reach next.

    Args:
        stream: Of which kind.
        seed: Of the demonstrations.
    """
    environments = {
        name: make_environment(Condition(behaviour=name, noise=stream.noise))
        for name in set(stream.shown)
    }
    seeds = demonstration_seeds(seed, len(stream.shown))
    rng = np.random.default_rng((seed, _RESTING))
    episodes = []
    for number, (name, own) in enumerate(zip(stream.shown, seeds, strict=True)):
        percepts = watch_demonstration(environments[name], own)
        percepts = np.concatenate([_rest(percepts, stream, rng), percepts])
        episodes.append(_demonstration(number, TASKS[name], percepts))
    for environment in environments.values():
        environment.close()
    return Demonstrations(FPS, FEATURES, tuple(episodes), "drinks")


def _rest(
    percepts: NDArray[np.float32], stream: Stream, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return what is perceived of a demonstrator that rests before it begins `[R, 28]`."""
    still = percepts[:_BEGINNING].mean(axis=0)
    noise = rng.standard_normal((round(stream.rest * FPS), PERCEPTS))
    return (still + stream.noise * noise_std()[:PERCEPTS] * noise).astype(np.float32)


def _demonstration(number: int, task: str, percepts: NDArray[np.float32]) -> Demonstration:
    rows = torch.from_numpy(percepts)
    state, glass = rows[:, : len(STATE_NAMES)], rows[:, len(STATE_NAMES) :]
    action = torch.from_numpy(motor_targets(percepts))
    return Demonstration(number, task, state.contiguous(), glass.contiguous(), action)


def numbers_of(
    shown: Sequence[Demonstration] | Demonstrations,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of the demonstration and of the task that each frame is of `[N]`."""
    names = list(dict.fromkeys(one.task for one in shown))
    frames = [len(one.state) for one in shown]
    tasks = [names.index(one.task) for one in shown]
    return np.repeat(np.arange(len(frames)), frames), np.repeat(tasks, frames)
