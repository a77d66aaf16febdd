"""Episodes of a scene: somebody acts, or a demonstrator is watched at the same place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.postural_imitation import PosturalImitationEnv, percept
from train.postural.alone.actors import Actor, Observation, Target, own_percept
from train.postural.alone.scenes import Scene

CONTACT = 0.03  # [m] from the grip to the glass's middle, where the hand is at the glass


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one actor did in an episode of T steps."""

    success: bool
    is_novel: bool  # in any step
    is_novel_in_time: bool  # in a step before the hand was at the glass
    step_seconds: float  # median of what a step of the actor took
    wrist: NDArray[np.float32]  # [T, 3] [m], own body frame
    percepts: NDArray[np.float32]  # [T, 28] of itself and its own glass
    held: NDArray[np.bool_]  # [T] whether the hand held the glass by then


@dataclass(frozen=True, eq=False)
class Shown:
    """What a demonstrator did in T steps at a place, and how an imitator that rests saw it."""

    wrist: NDArray[np.float32]  # [T, 3] [m], own body frame
    percepts: NDArray[np.float32]  # [T, 28] of the demonstrator and its glass
    phases: NDArray[np.str_]  # [T]


def act(
    actor: Actor,
    environment: PosturalImitationEnv,
    scene: Scene,
    seed: int,
    after_step: Callable[[int], None] = lambda _: None,
) -> Outcome:
    """Let somebody act for an episode; without a target the last one is held.

    Where the glass is out of reach, tipped or absent the episode ends when that is noticed.

    Args:
        actor: Who acts.
        environment: To act in.
        scene: The kind of the episode.
        seed: Of the episode.
        after_step: Called after each step with its number.
    """
    actor.reset()
    record = _Record(actor)
    observation, info = environment.reset(seed=seed, options=scene.options(seed))
    target = environment.rest_posture
    truncated = False
    while not (truncated or (record.is_novel and not scene.is_known)):
        wanted = record.step(observation, info)
        target = target if wanted is None else wanted
        observation, _, _, truncated, info = environment.step_to(target)
        after_step(len(record.seconds))
    return record.outcome(info["is_success"])


def demonstrate(environment: PosturalImitationEnv, seed: int, offset: tuple[float, float]) -> Shown:
    """Return what the demonstrator of an episode does, while the imitator rests and watches."""
    observation, info = environment.reset(seed=seed, options={"glass_offset": offset})
    steps = []
    truncated = False
    while not truncated:
        steps.append((info["demonstrator_wrist"], percept(observation), info["phase"]))
        observation, _, _, truncated, info = environment.step_to(environment.rest_posture)
    wrist, percepts, phases = map(np.array, zip(*steps, strict=True))
    return Shown(wrist.astype(np.float32), percepts, phases)


def demonstrate_again(
    environment: PosturalImitationEnv, seed: int, offset: tuple[float, float]
) -> Shown:
    """Return what another demonstrator does with a glass at the very place of an episode's."""
    _, info = environment.reset(seed=seed, options={"glass_offset": offset})
    place = info["glass_position"][:2]
    rng = np.random.default_rng((seed, 1))
    while True:
        other = int(rng.integers(2**31))
        _, info = environment.reset(seed=other)
        moved = tuple((place - info["glass_position"][:2]).tolist())
        try:
            return demonstrate(environment, other, moved)
        except ValueError:  # too far from where this demonstrator's glass would stand
            continue


class _Record:
    """What happens in an episode, step by step."""

    def __init__(self, actor: Actor) -> None:
        self._actor = actor
        self.is_novel = self._is_novel_in_time = self._was_at_glass = False
        self.seconds: list[float] = []
        self._infos: list[dict[str, Any]] = []
        self._percepts: list[NDArray[np.float32]] = []

    def step(self, observation: Observation, info: dict[str, Any]) -> Target:
        """Return the actor's target, and record what led to it."""
        started = perf_counter()
        target = self._actor.step(observation)
        self.seconds.append(perf_counter() - started)
        distance = np.linalg.norm(info["imitator_grip"] - info["glass_position"])
        self._was_at_glass |= bool(info["glass_held"] or distance < CONTACT)
        self.is_novel |= self._actor.is_novel
        self._is_novel_in_time |= self._actor.is_novel and not self._was_at_glass
        self._infos.append(info)
        self._percepts.append(own_percept(observation))
        return target

    def outcome(self, success: bool) -> Outcome:
        """Return what the whole episode was."""
        return Outcome(
            success,
            self.is_novel,
            self._is_novel_in_time,
            float(np.median(self.seconds)),
            np.array([info["imitator_wrist"] for info in self._infos], np.float32),
            np.stack(self._percepts),
            np.array([info["glass_held"] for info in self._infos]),
        )
