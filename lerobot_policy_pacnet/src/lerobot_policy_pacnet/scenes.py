"""The environments of the two experiments in the form in which LeRobot evaluates policies.

Observations have the names that LeRobot expects, actions the units of the datasets, and success is
reported at the end of an episode.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict

# [pixels]; LeRobot keeps the pictures of ten whole episodes in memory.
PICTURE = {"width": 320, "height": 176}  # multiples of 16, as video encoders need
TASKS = {  # in the words of the demonstrations that `python -m train.demonstrate` records
    "drink": "drink a glass of beer",
    "toast": "toast, then drink a glass of beer",
    "move": "move a glass over the table",
}
ENERGY = 0.5  # mean wall energy of an episode that is a success
_CHECKOUT = Path(__file__).resolve().parents[3]  # if installed from one with `pip install -e`

_Step = tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]


class Scene(gymnasium.Env[dict[str, Any], np.ndarray]):
    """Base class: an environment of `envs/`, and its pictures.

    Args:
        scene: the environment.
        task: its name.
        description: what to do, in words, which LeRobot passes to the policy.
        picture_every: steps between two rendered pictures. LeRobot asks for one at each step, but
            rendering takes a hundred times as long as the step.
    """

    def __init__(self, scene: Any, task: str, description: str, picture_every: int) -> None:
        self.scene = scene
        self.render_mode = scene.render_mode
        self.scene_task, self.scene_description = task, description
        self._picture_every = picture_every
        self._picture: np.ndarray | None = None
        self._asked = 0  # number of calls since the last picture was rendered

    def render(self) -> np.ndarray | None:
        """Return a picture (height, width, 3) uint8, a new one every `picture_every` calls."""
        if self._picture is None or self._asked >= self._picture_every:
            self._picture, self._asked = self.scene.render(), 0
        self._asked += 1
        return self._picture

    def close(self) -> None:
        """Free the simulation."""
        self.scene.close()

    def _begin(self, **options: Any) -> Any:
        """Reset the environment and return the observation."""
        self._picture = None
        return self.scene.reset(**options)[0]


class Told(gymnasium.Wrapper, gymnasium.utils.RecordConstructorArgs):
    """Says what to do around all other wrappers, where LeRobot asks for it."""

    def __init__(self, env: gymnasium.Env) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)

    @property
    def task(self) -> str:
        """Name of the task."""
        return self.get_wrapper_attr("scene_task")

    @property
    def task_description(self) -> str:
        """What to do in this episode, in words."""
        return self.get_wrapper_attr("scene_description")


class PosturalScene(Scene):
    """An imitator observes a demonstrator and acts; see `envs.postural_imitation`.

    Observation: ``agent_pos`` (22,) the demonstrator's perceived angles [rad] and velocities
    [rad/s], ``environment_state`` (6,) its glass. Action: joint angles (11,) [rad]. Success: the
    imitator's glass went where the behaviour takes it and ends in its initial place.

    Args:
        behaviour: "drink", "toast" or "move".
        render_mode: None or "rgb_array".
        noise_scale: factor on the perceptual noise.
        picture_every: as of `Scene`.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012  gymnasium's type
    # Entries of an observation, and what they are in the scene.
    perceived = {"agent_pos": "demonstrator", "environment_state": "glass"}  # noqa: RUF012

    def __init__(
        self,
        behaviour: str,
        render_mode: str | None = None,
        noise_scale: float = 1.0,
        picture_every: int = 1,
    ) -> None:
        scene = _module("envs.postural_imitation").PosturalImitationEnv(
            render_mode, behaviour=behaviour, noise_scale=noise_scale, **PICTURE
        )
        super().__init__(scene, behaviour, TASKS[behaviour], picture_every)
        seen = scene.observation_space
        angles = _module("envs.kinematics").BodyKinematics().joint_range.astype(np.float32)
        self.observation_space = Dict({name: seen[key] for name, key in self.perceived.items()})
        self.action_space = Box(angles[:, 0], angles[:, 1], dtype=np.float32)

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  these are LeRobot's, not the scene's
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode; the seed determines it."""
        return self._named(self._begin(seed=seed)), {"is_success": False}

    def step(self, action: np.ndarray) -> _Step:
        """Run one control step of 20 ms towards joint angles (11,) [rad]."""
        observation, reward, terminated, truncated, info = self.scene.step_to(action)
        success = bool(truncated and info["is_success"])
        return self._named(observation), reward, terminated, truncated, {"is_success": success}

    def _named(self, observation: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: observation[key] for name, key in self.perceived.items()}


class WallScene(Scene):
    """A robot follows a wall on its left or right side; see `envs.wall_following`.

    Observation: ``agent_pos`` (6,) infra-red readings. Action: wheel speeds (2,) as shares of
    0.12 m/s. Success: at the end the mean wall energy is at least 0.5.

    Args:
        episode_steps: after which an episode is truncated.
        render_mode: None or "rgb_array".
        noise_scale: factor on the perceptual noise.
        picture_every: as of `Scene`.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  gymnasium's type

    def __init__(
        self,
        episode_steps: int,
        render_mode: str | None = None,
        noise_scale: float = 1.0,
        picture_every: int = 1,
    ) -> None:
        module = _module("envs.wall_following")
        scene = module.WallFollowingEnv(render_mode, noise_scale=noise_scale, **PICTURE)
        super().__init__(scene, "follow", _follow("left"), picture_every)
        self.observation_space = Dict({"agent_pos": scene.observation_space})
        self.action_space = scene.action_space
        self._episode_steps = episode_steps
        self._energies: list[float] = []  # of the steps of this episode

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  these are LeRobot's, not the scene's
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode; the seed determines place and side."""
        super().reset(seed=seed)
        side = ("left", "right")[int(self.np_random.integers(2))]
        place = int(self.np_random.integers(2**31))
        self.scene_description = _follow(side)
        readings = self._begin(seed=place, options={"wall": side})
        self._energies = []
        return {"agent_pos": readings}, {"is_success": False}

    def step(self, action: np.ndarray) -> _Step:
        """Run one control step of 0.1 s at wheel speeds (2,), clipped to [-1, 1]."""
        readings, energy, terminated, _, _ = self.scene.step(np.clip(action, -1, 1))
        self._energies.append(energy)
        truncated = len(self._energies) >= self._episode_steps
        success = truncated and float(np.mean(self._energies)) >= ENERGY
        return {"agent_pos": readings}, energy, terminated, truncated, {"is_success": success}


def _follow(side: str) -> str:
    return f"follow the {side} wall"


def _module(name: str) -> ModuleType:
    """Import a module of the repository's `envs/`, which wheels do not contain.

    Raises:
        ModuleNotFoundError: no checkout of the repository, or MuJoCo is not installed.
    """
    if not _is_there(name):
        if not (_CHECKOUT / "envs" / "postural_imitation.py").is_file():
            raise ModuleNotFoundError(
                "expected pacnet's scenes, the folder envs/ of its repository: run this in a "
                "checkout, or install the plugin from one with `pip install -e`"
            )
        sys.path.append(str(_CHECKOUT))
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"expected the packages of pacnet's scenes, got {error}: install them with "
            "`pip install -e '.[experiments]'` in the checkout"
        ) from error


def _is_there(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False
