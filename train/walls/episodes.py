"""Episodes of Experiment 2: wandering, following a teacher, and acting alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

import envs  # noqa: F401  # registers the environment
from envs.khepera import wheel_speeds
from envs.wall_behaviours import Side, TrailFollower
from envs.wall_following import WallFollowingEnv
from train.walls.boredom import Bored
from train.walls.drivers import Driver, Wandering, shares
from train.walls.scores import WallRun

TAUGHT_SIDES: tuple[Side, Side] = ("left", "right")  # the order in which they are taught

NOISE_TURN = 0.6  # [rad/s] largest turn that is added to what a follower does
NOISE_RUN = 4  # [steps] for which it is held on average

_WANDERING, _FOLLOWING, _ALONE, _TESTING = 0, 1, 2, 3  # purposes for which seeds are drawn


def make_environment(
    arena: str | int,
    teacher: Side | None = None,
    noise: float = 1.0,
    camera: str | None = None,
    size: tuple[int, int] = (480, 480),
    *,
    teacher_rests: bool = False,
) -> WallFollowingEnv:
    """Return the environment without gymnasium's wrappers.

    Args:
        arena: "paper" or a seed.
        teacher: Side of its wall, or None for no teacher.
        noise: Factor on the noise of the readings.
        camera: To render with, or None.
        size: Width and height of a picture [pixels].
        teacher_rests: Whether the teacher stops for a minute now and then.
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
        teacher_rests=teacher_rests,
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


class MotorNoise:
    """Turns that are added to what a follower does, each held for a while.

    So a robot also gets a little off the teacher's way, feels what its wheels do there, and shows
    how to come back.

    Args:
        rng: Of the turns.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._turn = 0.0  # [rad/s]

    def wheels(self) -> NDArray[np.float64]:
        """Return the wheel speeds `[2]` [m/s] to add in the next step."""
        ends, turn = self._rng.random(), self._rng.uniform(-NOISE_TURN, NOISE_TURN)
        if ends < 1 / NOISE_RUN:
            self._turn = turn
        return wheel_speeds(0.0, self._turn)


def follow(
    arena: str | int,
    side: Side,
    seed: int,
    steps: int,
    after_step: Callable[[], Any] | None = None,
    *,
    rests: bool = False,
) -> Transitions:
    """Follow a teacher that follows walls, with noise on the wheels.

    Args:
        arena: "paper" or a seed.
        side: Of the teacher's wall.
        seed: Of the episode.
        steps: Number of steps.
        after_step: Called after each step.
        rests: Whether the teacher stops for a minute now and then; the learner stops with it.
    """
    environment = make_environment(arena, teacher=side, teacher_rests=rests)
    percept, info = environment.reset(seed=seed)
    follower = TrailFollower(info["pose"][:2], info["teacher_pose"][:2])
    noise = MotorNoise(np.random.default_rng([seed, 1]))  # [seed] alone is the environment's
    seen, done = [], []
    for _ in range(steps):
        wheels = follower.act(info["pose"], info["teacher_pose"][:2]) + noise.wheels()
        action = shares(0 * wheels if info["teacher_rests"] else wheels)
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
        driver: Of the robot, but for moments of boredom.
        place: Where and how it acts.
        seed: Of the initial position and of the noise.
        steps: Number of steps.
        after_step: Called after each step.
        camera: To render with, if `after_step` does.
    """
    environment = make_environment(place.arena, noise=place.noise, camera=camera)
    options = None if place.wall is None else {"wall": place.wall}
    percept, _ = environment.reset(seed=seed, options=options)
    driver = Bored(driver)
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
    )
