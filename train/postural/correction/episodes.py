"""Episodes of an imitator that pauses where all is new, and demonstrations for it to learn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from envs.postural_imitation import PosturalImitationEnv, percept
from pacnet.datasets.demonstrations import Demonstration
from pacnet.datasets.format.features import Feature
from pacnet.imitator.imitator import Imitator
from train.common.pool import share_out
from train.postural.episodes import TASK, Condition, make_environment
from train.postural_imitation import FEATURES, frames_of

Offset = tuple[float, float]  # [m] of the glasses from their usual place
USUAL: Offset = (0.0, 0.0)

COLUMNS = {
    **FEATURES,
    "novelty": ("novelty",),  # to the imitator, before it learned the episode
    "winner": Feature(("winner",), "int64"),  # node of its map, likewise
    "next.success": Feature(("success",), "bool"),
}


class Situation(NamedTuple):
    """What an episode is drawn from."""

    seed: int
    offset: Offset


class Pause(NamedTuple):
    """Where an imitator stopped, and what was new to it."""

    step: int
    dimension: str  # of the percept
    deviation: float  # more than what is known, in the dimension's own unit; less if negative
    tolerated: float  # of such a deviation, in size


@dataclass(frozen=True, eq=False)
class Attempt:
    """An episode of T steps in which the imitator did what it could, and paused where it was new.

    Attributes:
        novelty: at each step `[T]`; more than 1 is new.
        pause: the first time that it was; from there on the imitator held still.
        grasp: the step at which the demonstrator's hand was at its glass.
        contact: the step at which the imitator had its own glass in hand, or None.
        success: whether the imitator did what it was shown.
    """

    novelty: NDArray[np.float64]
    pause: Pause | None
    grasp: int
    contact: int | None
    success: bool

    @property
    def needs_nobody(self) -> bool:
        """Whether it did what it was shown without ever pausing."""
        return self.success and self.pause is None

    @property
    def paused_in_time(self) -> bool:
        """Whether it paused before anybody's hand was at a glass."""
        first = self.grasp if self.contact is None else min(self.grasp, self.contact)
        return self.pause is not None and self.pause.step < first


@dataclass(frozen=True, eq=False)
class Turn:
    """One attempt while the imitator is corrected, and what came of it.

    Attributes:
        place: number of the new place, from 1; 0 is the usual one.
        attempt: what the imitator did.
        learning: time that learning the correction took [s]; None without one.
    """

    place: int
    attempt: Attempt
    learning: float | None


def attempt(imitator: Imitator, environment: PosturalImitationEnv, situation: Situation) -> Attempt:
    """Lets an imitator act while the demonstrator does, until something is new to it.

    Args:
        imitator: a taught one.
        environment: to act in.
        situation: of the episode.
    """
    imitator.reset()
    observation, info = _begin(environment, situation)
    target, pause, truncated = environment.rest_posture, None, False
    novelty: list[float] = []
    infos = []
    while not truncated:
        step = imitator.step(percept(observation))
        if step.is_novel and pause is None:
            pause = Pause(len(novelty), step.dimension, step.deviation, step.tolerated)
        if step.action is not None and pause is None:
            target = step.action
        novelty.append(step.novelty)
        infos.append(info)
        observation, _, _, truncated, info = environment.step_to(target)
    return Attempt(
        novelty=np.array(novelty),
        pause=pause,
        grasp=[info["phase"] for info in infos].index("grasp"),
        contact=next((t for t, info in enumerate(infos) if info["glass_held"]), None),
        success=bool(info["is_success"]),
    )


def attempts(checkpoint: str | Path, situations: Sequence[Situation], label: str) -> list[Attempt]:
    """What a checkpoint does in each situation, in their order, on all cores.

    Args:
        checkpoint: folder of an imitator.
        situations: one an episode.
        label: of the progress bar.
    """
    return share_out(_Worker, (checkpoint,), situations, label)


class _Worker:
    """A loaded imitator and an environment that run episode after episode."""

    def __init__(self, checkpoint: str | Path) -> None:
        self.imitator = Imitator.from_pretrained(checkpoint).eval()
        self.environment = make_environment(Condition())

    def run(self, task: Situation) -> Attempt:
        return attempt(self.imitator, self.environment, task)


def demonstrate(
    environment: PosturalImitationEnv, situation: Situation
) -> tuple[dict[str, NDArray[np.float32]], NDArray[np.bool_]]:
    """The demonstrator shows, in this very situation, what is to be done; the imitator watches.

    Args:
        environment: to watch in.
        situation: of the demonstration.

    Returns:
        The features of what was seen, T frames, and whether after each of them it was done `[T]`.
    """
    observation, _ = _begin(environment, situation)
    percepts, done, truncated = [percept(observation)], [], False
    while not truncated:
        observation, _, _, truncated, info = environment.step_to(environment.rest_posture)
        percepts.append(percept(observation))
        done.append(info["demonstrator_success"])
    return frames_of(np.stack(percepts)), np.array([*done, done[-1]])


def as_demonstration(number: int, frames: dict[str, NDArray[np.float32]]) -> Demonstration:
    """What was seen, as an imitator learns it."""
    return Demonstration(number, TASK, *(torch.from_numpy(frames[name]) for name in FEATURES))


def columns_of(shown: Demonstration) -> dict[str, NDArray[np.generic]]:
    """A demonstration, as it is recorded."""
    values = (shown.state, shown.environment_state, shown.action)
    return {name: rows.numpy() for name, rows in zip(FEATURES, values, strict=True)}


def annotate(
    imitator: Imitator, shown: Demonstration, done: NDArray[np.bool_]
) -> dict[str, NDArray[np.generic]]:
    """The columns that are recorded beside a demonstration: what the imitator makes of it.

    Args:
        imitator: before it learns the demonstration.
        shown: T frames.
        done: whether after each of them it was done `[T]`.
    """
    imitator.reset()
    steps = [imitator.step(percepts) for percepts in shown.percepts]
    return {
        "novelty": np.array([[step.novelty] for step in steps]),
        "winner": np.array([[step.decision.winner] for step in steps]),
        "next.success": done[:, None],
    }


def _begin(
    environment: PosturalImitationEnv, situation: Situation
) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    return environment.reset(seed=situation.seed, options={"glass_offset": situation.offset})
