"""Episodes of an imitator that pauses while percepts are novel, and how it is corrected."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from envs.postural_imitation import PosturalImitationEnv, percept
from envs.scene import CONTROL_TIMESTEP
from pacnet.datasets.demonstrations import Demonstration
from pacnet.datasets.format.features import Feature
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import ImitatorStep
from train.common.pool import share_out
from train.postural.correction.questions import question
from train.postural.episodes import TASK, Condition, make_environment
from train.postural.learning import FEATURES, frames_of

Offset = tuple[float, float]  # of the glasses from their usual place [m]
USUAL: Offset = (0.0, 0.0)
PATIENCE = 5.0  # [s] that an imitator waits for an answer before its episode ends

COLUMNS = {
    **FEATURES,
    "novelty": ("novelty",),  # before the imitator learned the episode
    "winner": Feature(("winner",), "int64"),  # node of its map, before as well
    "next.success": Feature(("success",), "bool"),
}


class Situation(NamedTuple):
    """The seed of an episode and the place of the glasses in it."""

    seed: int
    offset: Offset
    is_alone: bool = False  # nobody demonstrates; the imitator perceives itself and its own glass
    own_glass: str = "standing"  # one of `envs.own_glass.OWN_GLASSES`

    @property
    def options(self) -> dict[str, Any]:
        """Return the options of the environment's reset."""
        presence = "absent" if self.is_alone else "present"
        return {
            "glass_offset": self.offset,
            "demonstrator": presence,
            "own_glass": self.own_glass,
        }

    def perceive(self, observation: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        """Return the percept `[28]`: of the demonstrator and its glass, or of its own."""
        if self.is_alone:
            return np.concatenate([observation["proprioception"], observation["own_glass"]])
        return percept(observation)


class Pause(NamedTuple):
    """Where an imitator stopped, and what was novel to it."""

    step: int
    dimension: str  # of the percept
    deviation: float  # from the known percepts, in the dimension's own unit
    tolerated: float  # largest deviation that is not novel
    asks: str = ""  # what would help; asked by an imitator that is alone


@dataclass(frozen=True, eq=False)
class Attempt:
    """An episode of T steps in which the imitator acted unless something was novel.

    Attributes:
        novelty: At each step `[T]`; above 1 a percept is novel.
        pause: The first novel step; the imitator holds still for as long as percepts are novel.
        grasp: Step at which the demonstrator's hand was at its glass; None without one.
        contact: Step at which the imitator held its own glass, or None.
        success: Whether the imitator completed the task.
    """

    novelty: NDArray[np.float64]
    pause: Pause | None
    grasp: int | None
    contact: int | None
    success: bool

    @property
    def is_autonomous(self) -> bool:
        """Return whether the imitator succeeded by itself; it may have paused on the way."""
        return self.success

    @property
    def paused_in_time(self) -> bool:
        """Return whether the imitator paused before any hand was at a glass."""
        contacts = [step for step in (self.grasp, self.contact) if step is not None]
        return self.pause is not None and self.pause.step < min(contacts, default=math.inf)


@dataclass(frozen=True, eq=False)
class Turn:
    """One attempt while the imitator is corrected, and its correction.

    Attributes:
        place: Number of the new place, from 1; 0 is the usual one.
        attempt: What the imitator did.
        learning: Duration of learning the correction [s]; None without one.
    """

    place: int
    attempt: Attempt
    learning: float | None


def attempt(imitator: Imitator, environment: PosturalImitationEnv, situation: Situation) -> Attempt:
    """Let an imitator act; it holds still while something is novel to it.

    Where its own glass is not in order, nobody helps within the episode: it ends `PATIENCE` after
    the imitator asked.

    Args:
        imitator: A trained one.
        environment: To act in.
        situation: Of the episode.
    """
    imitator.reset()
    observation, info = environment.reset(seed=situation.seed, options=situation.options)
    target, pause, is_over = environment.rest_posture, None, False
    novelty: list[float] = []
    infos = []
    while not is_over:
        perceived = situation.perceive(observation)
        step = imitator.step(perceived)
        if step.is_novel and pause is None:
            pause = _pause(len(novelty), step, perceived, situation)
        if step.action is not None:
            target = step.action
        novelty.append(step.novelty)
        infos.append(info)
        observation, _, _, is_over, info = environment.step_to(target)
        is_over |= pause is not None and _in_vain(situation, len(novelty) - pause.step)
    phases = [info["phase"] for info in infos]
    return Attempt(
        novelty=np.array(novelty),
        pause=pause,
        grasp=phases.index("grasp") if "grasp" in phases else None,
        contact=next((t for t, info in enumerate(infos) if info["glass_held"]), None),
        success=bool(info["is_success"]),
    )


def _pause(
    number: int, step: ImitatorStep, perceived: NDArray[np.float32], situation: Situation
) -> Pause:
    asks = question(step, perceived) if situation.is_alone else ""
    return Pause(number, step.dimension, step.deviation, step.threshold, asks)


def _in_vain(situation: Situation, steps: int) -> bool:
    """Return whether so many steps after the imitator asked, it waits for what does not come."""
    return situation.own_glass != "standing" and steps * CONTROL_TIMESTEP >= PATIENCE


def attempts(checkpoint: str | Path, situations: Sequence[Situation], label: str) -> list[Attempt]:
    """Return the attempts of a checkpoint in each situation, run on all cores.

    Args:
        checkpoint: Folder of an imitator.
        situations: One for each episode.
        label: Of the progress bar.
    """
    return share_out(_Worker, (checkpoint,), situations, label)


class _Worker:
    """Run episodes with a loaded imitator and an environment."""

    def __init__(self, checkpoint: str | Path) -> None:
        self.imitator = Imitator.from_pretrained(checkpoint).eval()
        self.environment = make_environment(Condition())

    def run(self, task: Situation) -> Attempt:
        return attempt(self.imitator, self.environment, task)


def demonstrate(
    environment: PosturalImitationEnv, situation: Situation
) -> tuple[dict[str, NDArray[np.float32]], NDArray[np.bool_]]:
    """Let the imitator watch a demonstration in this situation.

    Args:
        environment: To watch in.
        situation: Of the demonstration.

    Returns:
        The features of T frames, and whether the task was completed after each frame `[T]`.
    """
    options = {"glass_offset": situation.offset}
    observation, _ = environment.reset(seed=situation.seed, options=options)
    percepts, done, truncated = [percept(observation)], [], False
    while not truncated:
        observation, _, _, truncated, info = environment.step_to(environment.rest_posture)
        percepts.append(percept(observation))
        done.append(info["demonstrator_success"])
    return frames_of(np.stack(percepts)), np.array([*done, done[-1]])


def as_demonstration(number: int, frames: dict[str, NDArray[np.float32]]) -> Demonstration:
    """Return the recorded features as a demonstration to learn."""
    return Demonstration(number, TASK, *(torch.from_numpy(frames[name]) for name in FEATURES))


def columns_of(shown: Demonstration) -> dict[str, NDArray[np.generic]]:
    """Return a demonstration as recorded features."""
    values = (shown.state, shown.environment_state, shown.action)
    return {name: rows.numpy() for name, rows in zip(FEATURES, values, strict=True)}


def annotate(
    imitator: Imitator, shown: Demonstration, done: NDArray[np.bool_]
) -> dict[str, NDArray[np.generic]]:
    """Return the columns recorded beside a demonstration: novelty, winner, success.

    Args:
        imitator: Before it learns the demonstration.
        shown: Of T frames.
        done: Whether the task was completed after each frame `[T]`.
    """
    imitator.reset()
    percepts, sofm = shown.percepts.numpy(), imitator.sofm
    return {
        "novelty": np.array([[imitator.step(row).novelty] for row in percepts]),
        "winner": np.array([[sofm.read_one(row)[0].winner] for row in percepts]),
        "next.success": done[:, None],
    }
