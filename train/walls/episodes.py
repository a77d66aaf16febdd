"""Episodes of Experiment 2: wandering, following a teacher, and acting alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

import envs  # noqa: F401  # registers the environment
from envs.khepera import MAX_WHEEL_SPEED
from envs.wall_behaviours import Side, TrailFollower, WallFollower, Wanderer
from envs.wall_following import WallFollowingEnv
from pacnet import NO_NODE, PACNet
from train.walls.scores import WallRun

TAUGHT_SIDES: tuple[Side, Side] = ("left", "right")  # the order in which they are taught

_WANDERING, _FOLLOWING, _ALONE, _TESTING = 0, 1, 2, 3  # purposes for which seeds are drawn


class Driven(NamedTuple):
    """What drove the robot in one step."""

    action: NDArray[np.float32]  # [2] shares of the wheels' largest speed
    winner: int = NO_NODE  # node that won the percept
    commanded: bool = False  # by the network, not by the default behaviour
    abstained: bool = False  # a target was recalled, but the forward model gave no action


class Driver(Protocol):
    """Drives the robot alone."""

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        ...


class Wandering:
    """Drive by the default behaviour alone.

    Args:
        seed: Of its turns.
    """

    def __init__(self, seed: int) -> None:
        self._wanderer = Wanderer(np.random.default_rng(seed))

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        return Driven(shares(self._wanderer.act(percept)))


class Teacher:
    """Drive the learner's body by the teacher's controller.

    Args:
        side: Of the wall.
    """

    def __init__(self, side: Side) -> None:
        self._follower = WallFollower(side)

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        return Driven(shares(self._follower.act(percept)))


class Recalling:
    """Drive by a trained network; without an action, wander.

    Args:
        network: With a forward model.
        seed: Of the wandering.
    """

    def __init__(self, network: PACNet, seed: int) -> None:
        network.reset()
        self._network = network
        self._wanderer = Wanderer(np.random.default_rng(seed))

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        decision = self._network.step(percept)
        winner = NO_NODE if decision.is_novel else decision.winner
        if decision.action is not None:
            self._wanderer.take_over(MAX_WHEEL_SPEED * decision.action)
            return Driven(decision.action, winner, commanded=True)
        wandering = shares(self._wanderer.act(percept))
        return Driven(wandering, winner, abstained=decision.target is not None)


def shares(wheels: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return wheel speeds [m/s] as an action `[2]` of the environment, within its limits."""
    return np.clip(wheels / MAX_WHEEL_SPEED, -1, 1).astype(np.float32)


def make_environment(
    arena: str | int,
    teacher: Side | None = None,
    noise: float = 1.0,
    camera: str | None = None,
    size: tuple[int, int] = (480, 480),
) -> WallFollowingEnv:
    """Return the environment without gymnasium's wrappers.

    Args:
        arena: "paper" or a seed.
        teacher: Side of its wall, or None for no teacher.
        noise: Factor on the noise of the readings.
        camera: To render with, or None.
        size: Width and height of a picture [pixels].
    """
    environment = gymnasium.make(
        "pacnet/WallFollowing-v0",
        render_mode=None if camera is None else "rgb_array",
        arena=arena,
        teacher=teacher,
        noise_scale=noise,
        camera=camera or "top",
        width=size[0],
        height=size[1],
    ).unwrapped
    assert isinstance(environment, WallFollowingEnv)
    return environment


class Transitions(NamedTuple):
    """What a robot perceived and did, step by step."""

    percepts: NDArray[np.float32]  # [T, 6]
    actions: NDArray[np.float32]  # [T, 2]


def wander(arena: str | int, steps: int, seed: int) -> Transitions:
    """Wander alone from a place in the open.

    Args:
        arena: "paper" or a seed.
        steps: Number of steps.
        seed: Of the run.
    """
    environment = make_environment(arena)
    place, turns = seeds_for(seed, _WANDERING, 2)
    driver = Wandering(turns)
    percept, _ = environment.reset(seed=place)
    seen, done = [], []
    for _ in tqdm(range(steps), "wandering", unit="step"):
        action = driver.drive(percept).action
        seen.append(percept)
        done.append(action)
        percept = environment.step(action)[0]
    environment.close()
    return Transitions(np.stack(seen), np.stack(done))


def follow(
    arena: str | int, side: Side, seed: int, steps: int, after_step: Callable[[], Any] | None = None
) -> Transitions:
    """Follow a teacher that follows walls.

    Args:
        arena: "paper" or a seed.
        side: Of the teacher's wall.
        seed: Of the episode.
        steps: Number of steps.
        after_step: Called after each step.
    """
    environment = make_environment(arena, teacher=side)
    percept, info = environment.reset(seed=seed)
    follower = TrailFollower(info["pose"][:2], info["teacher_pose"][:2])
    seen, done = [], []
    for _ in range(steps):
        action = shares(follower.act(info["pose"], info["teacher_pose"][:2]))
        seen.append(percept)
        done.append(action)
        percept, _, _, _, info = environment.step(action)
        if after_step is not None:
            after_step()
    environment.close()
    return Transitions(np.stack(seen), np.stack(done))


@dataclass(frozen=True)
class Place:
    """Where and how a robot acts alone.

    Attributes:
        arena: "paper" or a seed.
        noise: Factor on the noise of the readings.
        wall: Side of the wall to begin beside; None to begin in the open.
    """

    arena: str | int
    noise: float = 1.0
    wall: Side | None = None


def act_alone(
    driver: Driver,
    place: Place,
    seed: int,
    steps: int,
    after_step: Callable[[WallFollowingEnv], Any] | None = None,
    camera: str | None = None,
) -> WallRun:
    """Let a robot act alone.

    Args:
        driver: Of the robot.
        place: Where and how it acts.
        seed: Of the initial position and of the noise.
        steps: Number of steps.
        after_step: Called after each step.
        camera: To render with, if `after_step` does.
    """
    environment = make_environment(place.arena, noise=place.noise, camera=camera)
    options = None if place.wall is None else {"wall": place.wall}
    percept, _ = environment.reset(seed=seed, options=options)
    rows: list[dict[str, Any]] = []
    for _ in range(steps):
        driven = driver.drive(percept)
        seen = percept
        percept, _, _, _, info = environment.step(driven.action)
        rows.append({**info, **driven._asdict(), "percept": seen})
        if after_step is not None:
            after_step(environment)
    environment.close()
    return _wall_run(rows)


def alone_seed(seed: int) -> int:
    """Return the seed of a run's episodes alone, which all begin at the same place."""
    return seeds_for(seed, _ALONE, 1)[0]


def following_seeds(seed: int, count: int) -> list[int]:
    """Return the seeds of a run's episodes of following, for both sides."""
    return seeds_for(seed, _FOLLOWING, count)


def testing_seed(seed: int) -> int:
    """Return the seed of the wandering on which a run's forward model is tested."""
    return seeds_for(seed, _TESTING, 1)[0]


def seeds_for(seed: int, purpose: int, count: int) -> list[int]:
    """Return independent seeds drawn from a run's."""
    return np.random.SeedSequence([seed, purpose]).generate_state(count).tolist()


def _wall_run(rows: list[dict[str, Any]]) -> WallRun:
    def series(name: str) -> NDArray[Any]:
        return np.stack([row[name] for row in rows])

    return WallRun(
        poses=series("pose"),
        percepts=series("percept"),
        wall_distance=series("wall_distance"),
        wall_side=series("wall_side"),
        progress=series("progress"),
        contact=series("contact"),
        winners=series("winner"),
        commanded=series("commanded"),
        abstained=series("abstained"),
    )
