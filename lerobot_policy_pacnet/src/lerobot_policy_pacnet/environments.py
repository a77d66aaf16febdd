"""The environments of `lerobot-eval --env.type=pacnet --env.task=TASK`, one for each experiment.

Importing this registers them; their simulators are imported when one is made.
"""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import gymnasium
from gymnasium.envs.registration import WrapperSpec
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_STATE


class Task(NamedTuple):
    """One environment."""

    entry_point: str
    arguments: dict[str, Any]
    fps: int  # [1/s]
    episode_steps: int  # the longest episode
    dimensions: dict[str, int]  # lengths of each entry of an observation and of the action


_POSTURES = {"agent_pos": 22, "environment_state": 6, ACTION: 11}
_WHEELS = {"agent_pos": 6, ACTION: 2}


def _postural(behaviour: str, scene: str = "scenes:PosturalScene") -> Task:
    entry_point = f"lerobot_policy_pacnet.{scene}"
    return Task(entry_point, {"behaviour": behaviour}, 50, 750, _POSTURES)


# Registered with gymnasium as gym_pacnet/NAME.
TASKS = {
    "Drink-v0": _postural("drink"),
    "Toast-v0": _postural("toast"),
    "Move-v0": _postural("move"),
    "DrinkAlone-v0": _postural("drink", "alone:AloneScene"),
    "FollowWalls-v0": Task(
        "lerobot_policy_pacnet.scenes:WallScene", {"episode_steps": 500}, 10, 500, _WHEELS
    ),
}

for _name, _task in TASKS.items():
    gymnasium.register(
        id=f"gym_pacnet/{_name}",
        entry_point=_task.entry_point,
        max_episode_steps=_task.episode_steps,
        kwargs=_task.arguments,
        additional_wrappers=(WrapperSpec("Told", "lerobot_policy_pacnet.scenes:Told", {}),),
    )


@EnvConfig.register_subclass("pacnet")
@dataclass
class PACNetEnv(EnvConfig):
    """Settings of an environment.

    Attributes:
        task: "Drink-v0", "Toast-v0" or "Move-v0", to imitate a demonstrator; "DrinkAlone-v0", to
            drink without one, from a glass up to 15 cm from where it usually stands; or
            "FollowWalls-v0".
        fps: frames per second [1/s]; set by the task.
        noise_scale: factor on the perceptual noise.
        picture_every: steps between two rendered pictures of a video, because rendering is slow.
        features_map: names of an observation's entries in datasets.

    Raises:
        ValueError: no such task.
    """

    task: str | None = "Drink-v0"
    noise_scale: float = 1.0
    picture_every: int = 5
    features_map: dict[str, str] = field(
        default_factory=lambda: {
            ACTION: ACTION,
            "agent_pos": OBS_STATE,
            "environment_state": OBS_ENV_STATE,
        }
    )

    def __post_init__(self) -> None:
        """Take rate and features from the task."""
        if self.task not in TASKS:
            raise ValueError(f"expected env.task to be one of {', '.join(TASKS)}, got {self.task}")
        task = TASKS[self.task]
        self.fps = task.fps
        kinds = {ACTION: FeatureType.ACTION, "environment_state": FeatureType.ENV}
        self.features = {
            name: PolicyFeature(kinds.get(name, FeatureType.STATE), (length,))
            for name, length in task.dimensions.items()
        }

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of `gymnasium.make`."""
        return {
            "render_mode": "rgb_array",
            "noise_scale": self.noise_scale,
            "picture_every": self.picture_every,
        }
