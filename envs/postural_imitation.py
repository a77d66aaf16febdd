"""Experiment 1 as a gymnasium environment: an imitator watches a demonstrator with a glass of beer.

Maistros, Marom & Hayes (2001), Experiment 1, and the behaviours that their schema network watches
(Figure 2). The action sets a target angle for each of the imitator's 11 joints; simulated PIDs
drive them. The demonstrator plays a seeded plan, and the episode ends with it.
"""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box

from envs.account import account
from envs.behaviours import BEHAVIOURS, PHASES, REST_POSTURE
from envs.demonstrator import Demonstration, plan_demonstration
from envs.drawing import draw_scene
from envs.head_camera import SIZE, camera_of
from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from envs.own_glass import own_glass_pose
from envs.perception import GLASS_NAMES, STATE_NAMES, Perception, percept
from envs.physics import CONTROL_TIMESTEP, Physics
from envs.postural_arguments import (
    check_arguments,
    check_choice,
    checked_joints,
    checked_options,
)
from envs.presence import attend, is_perceived
from envs.scene import GLASS_PLACE, IMITATOR, WHO
from envs.task import Deeds, final_place

GLASS_SPREAD = 0.01  # [m] largest offset of the glass from its nominal place, in x and in y
__all__ = ["GLASS_NAMES", "STATE_NAMES", "PosturalImitationEnv", "percept"]

SLACK = 1e-6  # for rounding errors of actions in [-1, 1]
REWARD_DISTANCE = 0.1  # [m] between the wrists at which the reward is 1/e


class PosturalImitationEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """Two waist-up humanoids face each other across a table, a glass before each.

    A right hand closes by itself on the glass within 3 cm of it when it moves slowly. It lets go
    when the glass, lifted before, is back on the table and slow.

    The demonstrator shows one behaviour. ``drink``: it takes its glass to the mouth, drinks and
    puts it back. ``toast``: the same, but it first raises the glass towards the other body, and at
    the end its hand stays beside the glass. ``move``: it puts the glass down elsewhere on the
    table. ``aside``: a drink, after which the glass is put down 10 cm to the right. A mishap can
    spoil an episode: a ``tremor`` of the right arm, ``interrupted`` soon after the glass was taken,
    or a ``miss``: the hand closes beside the glass and continues empty. The glasses stand within
    1 cm of their nominal place, or elsewhere by an option of `reset`.
    ``info`` says whether demonstrator and imitator have completed the behaviour (`envs.task`), and
    where the imitator's grip is: ``imitator_grip`` `[3]` [m] and ``imitator_hand`` `[3, 3]`, the
    rotation of its hand, in its body frame, as of `envs.kinematics.BodyKinematics.pose`.

    Action: targets of the imitator's joints `[11]` in the order of `envs.humanoid.JOINTS`, as
    shares of their ranges: -1 is a joint's lower limit, 1 its upper. `step_to` takes angles [rad]
    instead, such as `rest_posture` and `demonstrator_target`.

    Observation, noisy and clipped to its space: ``demonstrator`` `[22]` angles [rad] and velocities
    [rad/s], ``glass`` `[6]` the demonstrator's glass in the demonstrator's body frame, position [m]
    and rotation vector [rad] without the glass's turn about its own axis, ``proprioception`` `[22]`
    and ``own_glass`` `[6]` the same of the imitator's own body and glass, in its own body frame.

    Options of `reset` leave the imitator alone: a demonstrator ``leaves`` after one second, on its
    way to rest, or is ``absent``. Where nobody is perceived ``demonstrator`` is all zeros. The plan
    is drawn all the same, and the glasses stand at the same places. Other options spoil the
    imitator's glass, and then there is no success. ``info`` tells of a body that rests, and of a
    glass that is away behind the imitator, as of any other.

    Reward: exp(-d / 0.1 m), d the distance between both wrists, each in its own body frame, also
    where the demonstrator only rests.

    An episode is truncated at the end of the demonstration, or after 15 s (750 steps) if the
    demonstrator is not there by then; it never terminates. In further steps the demonstrator rests.
    """

    metadata = {  # noqa: RUF012  gymnasium's own type
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / CONTROL_TIMESTEP),
    }

    def __init__(
        self,
        render_mode: str | None = None,
        pace: float = 1.0,
        noise_scale: float = 1.0,
        width: int = 640,
        height: int = 360,
        behaviour: str = "drink",
    ) -> None:
        """Compile the scene.

        Args:
            render_mode: None or "rgb_array".
            pace: Of every demonstration; 1.25 is 25 % faster than nominal.
            noise_scale: Factor on the perceptual noise; 0 for none.
            width: Of a rendered picture [pixels].
            height: Of a rendered picture [pixels].
            behaviour: "drink", "toast", "move" or "aside".

        Raises:
            ValueError: An argument is out of its range.
        """
        check_arguments(render_mode, pace, noise_scale, width, height)
        check_choice("behaviour", behaviour, tuple(BEHAVIOURS))
        self.render_mode = render_mode
        self._pace, self._size = pace, (height, width)
        self._behaviour = behaviour
        self._physics = Physics.build()
        self._kinematics = BodyKinematics()
        self._perception = Perception(self._physics.joint_range, noise_scale)
        self._own_random: np.random.Generator  # from the first reset on
        self._low_angle, self._high_angle = self._physics.joint_range.T.copy()
        self._half_range = (self._high_angle - self._low_angle) / 2
        self.draws_with_gl = True  # until it fails
        self._demonstration: Demonstration | None = None  # until reset
        self.action_space = Box(-1.0, 1.0, shape=(len(JOINTS),), dtype=np.float32)
        self.observation_space = self._perception.space
        self.rest_posture = REST_POSTURE.astype(np.float32)

    @property
    def demonstrator_target(self) -> np.ndarray:
        """Return the demonstrator's target angles of the coming step `[11]` [rad]."""
        angles = self._plan.angles
        return angles[min(self._step + 1, len(angles) - 1)].copy()

    @property
    def episode_steps(self) -> int:
        """Return the number of steps of the whole episode."""
        return len(self._plan.angles) - 1

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Plan a demonstration and start at rest.

        Args:
            seed: Decides the plan, the glasses' place and the noise.
            options: ``mishap`` is "tremor", "interrupted" or "miss"; without it nothing goes wrong.
                ``glass_offset`` (dx, dy) [m], forwards and to the left of each body, puts both
                glasses elsewhere, at most 0.16 m away. ``demonstrator`` is "present", "leaves" or
                "absent". ``own_glass`` is "standing"; "tipped", on its side at its place; "far",
                out of reach on the table; or "absent", and then perceived as all zeros.

        Returns:
            Observation and info.

        Raises:
            ValueError: An option or its value is not known, or the glasses cannot stand there;
                nothing has changed.
        """
        checked = checked_options(options)
        super().reset(seed=seed, options=options)
        self._options = checked
        if seed is not None or self._demonstration is None:
            self._own_random = self.np_random.spawn(1)[0]  # leaves the numbers of the other as is
        spread = self.np_random.uniform(-GLASS_SPREAD, GLASS_SPREAD, size=2)
        self._place = np.array(GLASS_PLACE) + spread + self._options.glass_offset
        plan = plan_demonstration(
            self._kinematics,
            self._place,
            self.np_random,
            behaviour=self._behaviour,
            pace=self._pace,
            mishap=self._options.mishap,
        )
        self._demonstration = attend(plan, self._options.demonstrator)
        self._final_place = final_place(self._behaviour, self._place)
        self._step = 0
        self._deeds = (Deeds(), Deeds())
        self._set_scene(self._own_random)
        return self._observe(), self._describe()

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Run one control step of 20 ms.

        Args:
            action: The imitator's targets as shares of the joint ranges `[11]`, within [-1, 1].

        Returns:
            Observation, reward, terminated (False), truncated, info.

        Raises:
            ValueError: The action is not 11 finite numbers within [-1, 1]; nothing has moved.
            ResetNeeded: The environment was never reset.
        """
        shares = checked_joints("action", action)
        if max(map(abs, shares.tolist())) > 1 + SLACK:
            raise ValueError(
                f"action must be within [-1, 1], got {shares.min():.3g} to {shares.max():.3g}; "
                "step_to takes angles [rad]"
            )
        return self._advance(self._low_angle + self._half_range * (1 + shares))

    def step_to(
        self, angles: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Run one control step of 20 ms, as `step`, towards joint angles.

        Args:
            angles: The imitator's targets `[11]` [rad]; clipped to the joint ranges.

        Returns:
            Observation, reward, terminated (False), truncated, info.

        Raises:
            ValueError: The angles are not 11 finite numbers; nothing has moved.
            ResetNeeded: The environment was never reset.
        """
        return self._advance(checked_joints("angles", angles))

    def _advance(
        self, wanted: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Run one control step towards joint angles `[11]` [rad], clipped to the joint ranges."""
        wanted = np.minimum(np.maximum(wanted, self._low_angle), self._high_angle)
        self._physics.advance((self.demonstrator_target, wanted))
        self._step += 1
        wrist = self._physics.scene_state.wrist
        apart = wrist[1] - wrist[0]
        reward = float(np.exp(-math.sqrt(apart.dot(apart)) / REWARD_DISTANCE))
        truncated = self._step >= self.episode_steps
        return self._observe(), reward, False, truncated, self._describe()

    def release(self, who: str = IMITATOR) -> None:
        """Let a hand let go of its glass, wherever it is.

        Args:
            who: "demonstrator" or "imitator".

        Raises:
            ValueError: `who` is neither.
        """
        check_choice("who", who, WHO)
        self._physics.release(WHO.index(who))

    def render(self) -> np.ndarray | None:
        """Draw both bodies from the side, with Pillow if OpenGL is not available.

        Returns:
            A picture `[height, width, 3]` uint8, or None without a render mode.

        Raises:
            ResetNeeded: The environment was never reset.
        """
        if self.render_mode is None:
            return None
        _ = self._plan  # raises before reset
        if self.draws_with_gl:
            try:
                return self._physics.render(*self._size, camera_id=self._physics.camera)
            except Exception:  # each backend raises its own kind
                self.draws_with_gl = False
        return draw_scene(self._physics, *self._size)

    def look(self, who: str = IMITATOR) -> np.ndarray:
        """Draw what a camera beside a body's head sees, without OpenGL: see `envs.head_camera`.

        The same state gives the same bytes, whatever the render mode.

        Args:
            who: "demonstrator" or "imitator".

        Returns:
            A picture `[128, 128, 3]` uint8.

        Raises:
            ValueError: `who` is neither.
            ResetNeeded: The environment was never reset.
        """
        _ = self._plan  # raises before reset
        check_choice("who", who, WHO)
        return draw_scene(self._physics, SIZE, SIZE, camera_of(who))

    def close(self) -> None:
        """Free the simulation and its OpenGL context."""
        self._physics.free()

    @property
    def _plan(self) -> Demonstration:
        """Return the demonstration of this episode, or raise ResetNeeded."""
        if self._demonstration is None:
            raise ResetNeeded("expected a call of reset first, the environment was never reset")
        return self._demonstration

    def _set_scene(self, rng: np.random.Generator) -> None:
        """Put bodies and glasses where an episode begins; the generator decides about its own."""
        self._physics.stage(
            demonstrator=self._options.demonstrator != "absent",
            own_glass=self._options.own_glass != "absent",
        )
        self._physics.begin(
            np.stack([self._plan.angles[0], REST_POSTURE]),
            self._place,
            own_glass_pose(self._options.own_glass, self._place, rng),
        )

    def _observe(self) -> dict[str, np.ndarray]:
        """Return noisy percepts of the state, as float32 within the space."""
        return self._perception.observe(
            self._physics.scene_state,
            self.np_random,
            self._own_random,
            sees_demonstrator=is_perceived(self._options.demonstrator, self._step),
            sees_own_glass=self._options.own_glass != "absent",
        )

    def _describe(self) -> dict[str, Any]:
        """Return the true state and the task's measures."""
        physics, phases = self._physics, self._plan.phases
        info = account(
            physics.scene_state, physics.grips, self._deeds, self._behaviour, self._final_place
        )
        info["phase"] = PHASES[phases[min(self._step, len(phases) - 1)]]
        info["is_success"] = info["is_success"] and self._options.own_glass == "standing"
        return info
