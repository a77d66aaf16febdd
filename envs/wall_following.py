"""Experiment 2 as a gymnasium environment: a robot that perceives walls by infra-red sensors.

Maistros, Marom & Hayes (2001), Experiment 2. A teacher, if there is one, follows walls
ahead of the learner; otherwise the learner is alone.
"""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box

from envs.arena import make_arena
from envs.arena_drawing import draw_arena, render_arena
from envs.arena_physics import ArenaPhysics
from envs.arena_scene import CONTROL_TIMESTEP, MAX_HEIGHT, MAX_WIDTH
from envs.khepera import INFRARED_NAMES, MAX_WHEEL_SPEED
from envs.placement import following_poses, open_pose, wall_pose
from envs.wall_behaviours import CRUISE, WALL_DISTANCE, RestingFollower, Side, WallFollower

NOISE = 0.01  # standard deviation of a reading
NEAR = 0.05  # [m] from the rim, within which a wall counts as beside the robot
ENERGY_WIDTH = 0.010  # [m] the sensors' own length
SLACK = 1e-6  # for rounding errors of actions in [-1, 1]
LEARNER, TEACHER = 0, 1
CAMERAS = ("top", "chase")


class WallFollowingEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A Khepera-like robot in a walled arena, alone or behind a teacher.

    Action: speeds of the left and the right wheel `[2]` as shares of 0.12 m/s, in [-1, 1].
    `step_to` takes the speeds themselves [m/s].

    Observation: six infra-red readings `[6]` from left to right (`envs.khepera.INFRARED_NAMES`),
    0 for nothing within 70 mm, 1 at contact, with noise of 0.01, clipped to [0, 1].

    Reward: the wall energy of the step, exp(-((d - 26 mm) / 10 mm)² / 2) · min(1, p / 6 mm), where
    d is the distance from rim to wall and p the progress along the wall.

    Info: `pose` `[3]` [m, m, rad], `wall_distance` [m] from the rim, `wall_side` (1 left, -1 right,
    0 none within 50 mm), `progress` [m] along the nearest wall in this step, `contact`, and
    if there is a teacher, `teacher_pose` `[3]` and `teacher_rests`: whether it stands still in the
    next step.

    Episodes neither terminate nor truncate by themselves; `gymnasium.make` ends them after 2,500
    steps.
    """

    metadata = {  # noqa: RUF012  gymnasium's own type
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / CONTROL_TIMESTEP),
    }

    def __init__(
        self,
        render_mode: str | None = None,
        arena: str | int = "paper",
        teacher: Side | None = None,
        noise_scale: float = 1.0,
        camera: str = "top",
        width: int = 640,
        height: int = 360,
        teacher_rests: bool = False,
    ) -> None:
        """Compile the arena.

        Args:
            render_mode: None or "rgb_array".
            arena: "paper", or the seed of a random one.
            teacher: Side of the teacher's wall; None for no teacher.
            noise_scale: Factor on the noise of the readings; 0 for none.
            camera: "top" sees the whole arena, "chase" follows the learner.
            width: Of a rendered picture [pixels].
            height: Of a rendered picture [pixels].
            teacher_rests: Whether the teacher stops for a minute now and then.

        Raises:
            ValueError: An argument is out of its range.
        """
        _check_arguments(render_mode, teacher, noise_scale, camera, width, height)
        self.arena = make_arena(arena)
        self.render_mode = render_mode
        self._camera, self._size = camera, (height, width)
        self.draws_with_gl = True  # until it fails
        robots = ("learner",) if teacher is None else ("learner", "teacher")
        self._physics = ArenaPhysics.build(self.arena, robots)
        self._side: Side | None = teacher
        self._kind = RestingFollower if teacher_rests else WallFollower
        self._teacher: WallFollower | None = None  # until reset
        self._noise = NOISE * noise_scale
        self._was_reset = False
        self.action_space = Box(-1.0, 1.0, shape=(2,), dtype=np.float32)
        self.observation_space = Box(0.0, 1.0, shape=(len(INFRARED_NAMES),), dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Put the learner in the open; a teacher ahead of it, on its way to a wall.

        Args:
            seed: Decides places and noise.
            options: `{"wall": "left"}` or `"right"` puts a learner that is alone beside a wall.

        Returns:
            Observation and info.

        Raises:
            ValueError: An unknown option, or a wall for a learner with a teacher.
        """
        wall = _wanted_wall(options)
        if wall is not None and self._side is not None:
            raise ValueError(f"options must be empty with a teacher, got {options!r}")
        super().reset(seed=seed, options=options)
        self._teacher = None if self._side is None else self._kind(self._side)
        self._physics.begin(self._draw_poses(wall))
        self._was_reset = True
        return self._perceive(LEARNER), self._describe(self._physics.poses[LEARNER])

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Run one control step of 0.1 s.

        Args:
            action: Speeds of the left and the right wheel `[2]` as shares of 0.12 m/s.

        Returns:
            Observation, reward, terminated (False), truncated (False), info.

        Raises:
            ValueError: The action is not 2 finite numbers within [-1, 1]; nothing has moved.
            ResetNeeded: The environment was never reset.
        """
        shares = _checked("action", action)
        if max(map(abs, shares.tolist())) > 1 + SLACK:
            raise ValueError(
                f"action must be within [-1, 1], got {shares}; step_to takes wheel speeds [m/s]"
            )
        return self.step_to(MAX_WHEEL_SPEED * shares)

    def step_to(
        self, wheel_speeds: np.ndarray
    ) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Run one control step of 0.1 s, as `step`, at wheel speeds.

        Args:
            wheel_speeds: Of the left and the right wheel `[2]` [m/s]; clipped to ±0.12 m/s.

        Returns:
            Observation, reward, terminated (False), truncated (False), info.

        Raises:
            ValueError: The speeds are not 2 finite numbers; nothing has moved.
            ResetNeeded: The environment was never reset.
        """
        wanted = _checked("wheel_speeds", wheel_speeds)
        wanted = np.minimum(np.maximum(wanted, -MAX_WHEEL_SPEED), MAX_WHEEL_SPEED)
        self._check_reset()
        wheels = [wanted]
        if self._teacher is not None:
            wheels.append(self._teacher.act(self._perceive(TEACHER)))
        before = self._physics.poses[LEARNER]
        self._physics.advance(np.array(wheels))
        info = self._describe(before)
        return self._perceive(LEARNER), _energy(info), False, False, info

    def render(self) -> np.ndarray | None:
        """Draw the arena, the robots and the rays of the learner's sensors.

        Pillow draws if OpenGL is not available.

        Returns:
            A picture `[height, width, 3]` uint8, or None without a render mode.

        Raises:
            ResetNeeded: The environment was never reset.
        """
        if self.render_mode is None:
            return None
        self._check_reset()
        view = (self._physics, self._camera, *self._size)
        if self.draws_with_gl:
            try:
                return render_arena(*view)
            except Exception:  # each backend raises its own kind
                self.draws_with_gl = False
        return draw_arena(*view)

    def close(self) -> None:
        """Free the simulation and its OpenGL context."""
        self._physics.free()

    def _check_reset(self) -> None:
        if not self._was_reset:
            raise ResetNeeded("expected a call of reset first, the environment was never reset")

    def _draw_poses(self, wall: Side | None) -> np.ndarray:
        """Draw the initial poses `[R, 3]` [m, m, rad]."""
        if self._teacher is not None:
            return following_poses(self.arena, self.np_random, self._teacher.side)
        if wall is not None:
            return wall_pose(self.arena, self.np_random, wall)[None]
        return open_pose(self.arena, self.np_random)[None]

    def _perceive(self, robot: int) -> np.ndarray:
        """Return a robot's noisy readings `[6]` float32."""
        truth = self._physics.infrared(robot)
        noisy = truth + self._noise * self.np_random.standard_normal(len(truth))
        return np.minimum(np.maximum(noisy, 0.0), 1.0).astype(np.float32)

    def _describe(self, before: np.ndarray) -> dict[str, Any]:
        """Return the true state of the learner; `before` is its pose one step ago."""
        poses, wall = self._physics.poses, self._physics.nearest_wall(LEARNER)
        pose = poses[LEARNER]
        x, y, heading = pose.tolist()
        x_before, y_before, _ = before.tolist()
        x_to_wall, y_to_wall = wall.direction.tolist()
        is_left = math.cos(heading) * y_to_wall - math.sin(heading) * x_to_wall > 0
        info = {
            "pose": pose,
            "wall_distance": wall.distance,
            "wall_side": 0 if wall.distance > NEAR else 1 if is_left else -1,
            "progress": abs((y - y_before) * x_to_wall - (x - x_before) * y_to_wall),
            "contact": self._physics.touches(LEARNER),
        }
        if self._teacher is not None:
            info["teacher_pose"] = poses[TEACHER]
            info["teacher_rests"] = self._teacher.rests
        return info


def _energy(info: dict[str, Any]) -> float:
    """Return the wall energy of one step, from 0 to 1."""
    off = (info["wall_distance"] - WALL_DISTANCE) / ENERGY_WIDTH
    return math.exp(-0.5 * off * off) * min(1.0, info["progress"] / (CRUISE * CONTROL_TIMESTEP))


def _check_arguments(
    render_mode: str | None,
    teacher: str | None,
    noise_scale: float,
    camera: str,
    width: int,
    height: int,
) -> None:
    """Refuse invalid arguments of the environment."""
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
    if teacher not in (None, "left", "right"):
        raise ValueError(f"teacher must be None, 'left' or 'right', got {teacher!r}")
    if not 0 <= noise_scale < math.inf:
        raise ValueError(f"noise_scale must be finite and at least 0, got {noise_scale}")
    if camera not in CAMERAS:
        raise ValueError(f"camera must be one of {CAMERAS}, got {camera!r}")
    if not (0 < width <= MAX_WIDTH and 0 < height <= MAX_HEIGHT):
        raise ValueError(
            f"width and height must be within {MAX_WIDTH} x {MAX_HEIGHT}, got {width} x {height}"
        )


def _wanted_wall(options: dict[str, Any] | None) -> Side | None:
    """Return the side of the wall to begin beside, or raise a ValueError."""
    wanted = dict(options or {})
    wall = wanted.pop("wall", None)
    if wanted or wall not in (None, "left", "right"):
        raise ValueError(f"options must be {{'wall': 'left' or 'right'}} or none, got {options!r}")
    return wall


def _checked(name: str, value: np.ndarray) -> np.ndarray:
    """Return the value as float64 `[2]`, or raise a ValueError."""
    expected = f"{name} must be 2 finite numbers"
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{expected}, got {value!r}") from error
    if numbers.shape != (2,):
        raise ValueError(f"{expected}, got shape {numbers.shape}")
    if not all(map(math.isfinite, numbers.tolist())):
        raise ValueError(f"{expected}, got {value!r}")
    return numbers
