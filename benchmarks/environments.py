"""Control steps of both scenes, compared with plain physics.

Run it alone with `python -m benchmarks.environments`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium
import mujoco
import numpy as np

import envs  # noqa: F401  registers the environments
from benchmarks.harness import Table, number, run_alone
from envs import arena_scene, scene
from envs.khepera import MAX_WHEEL_SPEED
from envs.wall_behaviours import Wanderer

HUMANOIDS, ARENA = "pacnet/PosturalImitation-v0", "pacnet/WallFollowing-v0"
EPISODES, CONTROL_STEPS = 8, 325  # as long as the shortest demonstration
TURN = 25  # control steps

TEXT = f"""The environment runs {TURN} control steps. Then plain `mj_step` runs the same model from
the same state, with the same controls and number of substeps. Medians over all such turns in
{EPISODES} episodes, one thread. `step` is that of the environment from `gymnasium.make`; `step_to`
takes angles. Both humanoids move: one demonstrates drinking, the other imitates it. In the arena
the learner wanders, and the teacher follows walls.
"""


class Case(NamedTuple):
    """One row."""

    name: str
    env: Any  # the environment with its wrappers
    step: Callable[[np.ndarray], tuple]  # what is measured
    choose: Callable[[Any], np.ndarray]  # an action for an observation, not measured
    n_substeps: int
    wanted: float  # speed relative to plain physics


class Turn(NamedTuple):
    """Speeds of one turn [control steps/s]."""

    env: float
    bare: float


def humanoids(method: str) -> Case:
    """Return the case in which the imitator's targets are the demonstrator's."""
    env = gymnasium.make(HUMANOIDS)
    inner: Any = env.unwrapped
    low, high = inner._physics.joint_range.T

    def choose(_: object) -> np.ndarray:
        angles = inner.demonstrator_target
        if method == "step_to":
            return angles
        shares = 2 * (angles - low) / (high - low) - 1
        return shares.clip(-1, 1).astype(np.float32)

    step = inner.step_to if method == "step_to" else env.step
    return Case(f"humanoids, `{method}`", env, step, choose, scene.N_SUBSTEPS, wanted=0.5)


def arena(teacher: str | None) -> Case:
    """Return the case in which the learner wanders."""
    env = gymnasium.make(ARENA, teacher=teacher)
    wanderer = Wanderer(np.random.default_rng(0))

    def choose(observation: np.ndarray) -> np.ndarray:
        return (wanderer.act(observation) / MAX_WHEEL_SPEED).astype(np.float32)

    name = "arena, `step`" if teacher is None else "arena with a teacher, `step`"
    return Case(name, env, env.step, choose, arena_scene.N_SUBSTEPS, wanted=0.4)


def episode(case: Case, seed: int) -> Iterator[Turn]:
    """Yield the turns of one episode."""
    physics = case.env.unwrapped._physics
    model, data = physics.model.ptr, physics.data.ptr
    bare = mujoco.MjData(model)
    observation, _ = case.env.reset(seed=seed)
    for _ in range(CONTROL_STEPS // TURN):
        mujoco.mj_copyData(bare, model, data)
        in_env = in_bare = 0.0  # [s]
        controls = []
        for _ in range(TURN):
            action = case.choose(observation)
            start = time.perf_counter()
            observation, *_ = case.step(action)
            in_env += time.perf_counter() - start
            controls.append(data.ctrl.copy())
        for control in controls:
            bare.ctrl[:] = control
            start = time.perf_counter()
            mujoco.mj_step(model, bare, case.n_substeps)
            in_bare += time.perf_counter() - start
        yield Turn(TURN / in_env, TURN / in_bare)


def measure() -> list[Table]:
    """Measure one row for each environment and way to step it."""
    cases = [humanoids("step"), humanoids("step_to"), arena(None), arena("left")]
    measured: dict[str, list[Turn]] = {case.name: [] for case in cases}
    for seed in range(EPISODES):
        for case in cases:
            measured[case.name] += episode(case, seed)
    rows = [_row(case, measured[case.name]) for case in cases]
    columns = ("what", "control steps/s", "plain `mj_step`", "ratio", "wanted")
    return [Table("The scenes, compared with plain physics", TEXT, columns, rows)]


def _row(case: Case, turns: list[Turn]) -> tuple[str, ...]:
    env, bare = (statistics.median(speeds) for speeds in zip(*turns, strict=True))
    ratio = statistics.median(turn.env / turn.bare for turn in turns)
    return case.name, number(env), number(bare), f"{ratio:.2f} ×", f"≥ {case.wanted} ×"


if __name__ == "__main__":
    run_alone(__doc__, measure)
