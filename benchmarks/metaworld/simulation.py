"""One task of Metaworld as a simulated world: places from a seed, steps, its scripted expert.

Physics, places and success are those of Metaworld 3.1.1. Its shaped reward and its quaternions are
left out: nobody reads them here, and they take most of a step's time.
`python -m benchmarks.metaworld.check_simulation` shows that nothing else changes.
"""

from __future__ import annotations

import importlib.util
import os
from typing import Any

import numpy as np

from benchmarks.metaworld.features import Array

FPS = 80  # [1/s]
HORIZON = 300  # steps after which an episode has failed
NEEDED = "metaworld"
_VERSION = "-v3"


class World:
    """A task that can be reset to places decided by a seed alone.

    Args:
        task: its name without a version, as in `tasks`.
        whole: whether reward and quaternions are computed; they change nothing that is read here.
            In a process that has had a world without, there are no more rewards.

    Raises:
        ValueError: Metaworld has no such task.
    """

    def __init__(self, task: str, *, whole: bool = False) -> None:
        os.environ.setdefault("MUJOCO_GL", "disable")  # before MuJoCo is imported
        from metaworld.env_dict import ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE
        from metaworld.policies import ENV_POLICY_MAP

        if task not in known_tasks():
            raise ValueError(f"expected one of {', '.join(known_tasks())}, got {task!r}")
        self.task = task
        make = ALL_V3_ENVIRONMENTS_GOAL_OBSERVABLE[f"{task}{_VERSION}-goal-observable"]
        self.env: Any = make(seed=0)
        self.env._freeze_rand_vec = False  # new places at each reset ...
        self.env.seeded_rand_vec = True  # ... that the seed decides, not NumPy's global generator
        self._policy: Any = ENV_POLICY_MAP[f"{task}{_VERSION}"]()
        if not whole:
            _leave_out_reward()
            _leave_out_of(self.env)

    def reset(self, seed: int) -> Array:
        """Start an episode; return its first observation `[39]`.

        What the simulation derives from places is computed anew before it is observed: right after
        Metaworld's own reset some objects are still seen where the episode before left them.
        """
        import mujoco

        self.env.seed(seed)
        self.env.reset()
        mujoco.mj_forward(self.env.model, self.env.data)
        return self.env._get_obs()

    def step(self, action: Array) -> tuple[Array, bool]:
        """Take one step of 1 / `FPS` seconds; return the observation `[39]` and success."""
        command = np.clip(action, -1, 1).astype(np.float32)
        observation, _, _, _, info = self.env.step(command)
        return observation, bool(info["success"])

    def expert(self, observation: Array) -> Array:
        """Return the scripted expert's action `[4]`, within ±1."""
        return np.clip(np.asarray(self._policy.get_action(observation), np.float64), -1, 1)


def known_tasks() -> tuple[str, ...]:
    """Return the names of all tasks of Metaworld, without a version."""
    from metaworld.policies import ENV_POLICY_MAP

    return tuple(sorted(name.removesuffix(_VERSION) for name in ENV_POLICY_MAP))


def is_installed() -> bool:
    """Return whether Metaworld can be imported."""
    return importlib.util.find_spec(NEEDED) is not None


def _leave_out_reward() -> None:
    """Replace what only rewards are made of by constants, in all worlds of this process."""
    from metaworld.utils import reward_utils

    for name in ("tolerance", "hamacher_product", "rect_prism_tolerance"):
        setattr(reward_utils, name, _nothing)


def _leave_out_of(env: Any) -> None:
    """Replace what only rewards and quaternions are made of by constants, in one environment."""
    still = np.zeros_like(env._get_quat_objects())
    env._get_quat_objects = lambda: still
    env._gripper_caging_reward = _nothing
    env.touching_object = lambda *_: False


def _nothing(*_: object, **__: object) -> float:
    return 0.0
