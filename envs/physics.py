"""The simulated scene behind named queries, for both bodies at once, each in its own frame.

Row 0 is the demonstrator, row 1 the imitator. A body frame has its origin at the pelvis, x
forwards, y to the left, z up. Indices are looked up once; no Python runs in the substeps.
"""

from typing import NamedTuple

import numpy as np
from dm_control import mujoco
from mujoco import mju_mulQuat, mju_negQuat, mju_rotVecQuat  # pyright: ignore[reportAttributeAccessIssue]

from envs import scene
from envs.grip import Grip
from envs.humanoid import JOINTS
from envs.scene import (
    CONTROL_TIMESTEP,
    GLASS_HEIGHT,
    GLASS_REST_Z,
    GRIP_HEIGHT,
    GRIP_STRETCH,
    N_SUBSTEPS,
    ROOT_DISTANCE,
    ROOT_HEIGHT,
    WHO,
)

SMOOTHING = 0.25  # per control step, of the velocity by which a hand decides

_ORIGIN = np.array([[-ROOT_DISTANCE / 2, 0, ROOT_HEIGHT], [ROOT_DISTANCE / 2, 0, ROOT_HEIGHT]])
_FACING = np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0]])  # half a turn about z is its own inverse


class SceneState(NamedTuple):
    """What is true of both bodies and glasses at one instant, in their own body frames."""

    angles: np.ndarray  # (2, 11) [rad]
    velocities: np.ndarray  # (2, 11) [rad/s] mean over the last control step
    wrist: np.ndarray  # (2, 3) [m]
    grip: np.ndarray  # (2, 3) [m]
    mouth: np.ndarray  # (2, 3) [m]
    glass: np.ndarray  # (2, 3) [m] the glass's middle
    axis: np.ndarray  # (2, 3) the glass's axis, of length one


class Physics(mujoco.Physics):
    """Two humanoids, a table and two glasses."""

    @classmethod
    def build(cls) -> "Physics":
        """Compiles the scene."""
        model = scene.build_scene()
        physics = cls.from_xml_string(model.to_xml_string(), model.get_assets())
        physics._look_up()
        return physics

    def _look_up(self) -> None:
        """Finds every index once, rows as in `WHO`."""
        model = self.model

        def ids(kind: str, *names: str) -> np.ndarray:
            return np.array([model.name2id(name, kind) for name in names])

        joints = ids("joint", *(f"{who}/{joint}" for who in WHO for joint in JOINTS))
        self.angle_at = model.jnt_qposadr[joints].reshape(2, -1)  # (2, 11) into qpos
        self.velocity_at = model.jnt_dofadr[joints].reshape(2, -1)  # (2, 11) into qvel
        self.camera = int(model.name2id(scene.CAMERA, "camera"))
        self.joint_range = model.jnt_range[joints[: len(JOINTS)]].copy()  # (11, 2) [rad]
        self._sites = ids(
            "site", *(f"{who}/{s}" for s in ("wrist", "grip", "mouth") for who in WHO)
        )
        self._forearms = ids("body", *(f"{who}/rradius" for who in WHO))
        self._glasses = ids("body", *(f"{who}_glass" for who in WHO))
        self._holds = ids("equality", *(f"{who}_grip" for who in WHO))
        self._glass_at = model.jnt_qposadr[ids("joint", *(f"{who}_glass" for who in WHO))]
        self.grips = (Grip(), Grip())

    def begin(self, angles: np.ndarray, glass_place: np.ndarray) -> None:
        """Starts an episode at rest, both glasses standing.

        Args:
            angles: of both bodies (2, 11) [rad].
            glass_place: where each body's glass stands in its own frame (2,) [m].
        """
        with self.reset_context():
            self.data.qpos[self.angle_at] = angles
            standing = np.array([*glass_place, GLASS_REST_Z]) * _FACING + _ORIGIN
            for address, position in zip(self._glass_at, standing, strict=True):
                self.data.qpos[address : address + 3] = position
        # The integral terms begin where they hold the arms against gravity.
        load = self.data.qfrc_bias[self.velocity_at].ravel()
        self.data.act[:] = load / scene.integral_gains()
        self.grips = (Grip(), Grip())
        self._velocity = np.zeros((2, 3))  # [m/s] of the grip at the glass, smoothed
        self.scene_state = self._read(angles)

    def advance(self, targets: np.ndarray) -> None:
        """Runs one control step of `CONTROL_TIMESTEP`.

        Args:
            targets: joint angles of both bodies (2, 11) [rad].
        """
        self.data.ctrl[:] = targets.ravel()
        self.step(N_SUBSTEPS)
        before, self.scene_state = self.scene_state, self._read(self.scene_state.angles)
        self._update_grips(before)

    def release(self, row: int) -> None:
        """Makes a hand let go of its glass."""
        self.grips[row].release()
        self.data.eq_active[self._holds[row]] = 0

    def _read(self, before: np.ndarray) -> SceneState:
        """Reads the state, `before` being the angles one control step ago; no array is shared."""
        data = self.data
        sites = data.site_xpos[self._sites].reshape(3, 2, 3)
        wrist, grip, mouth = (sites - _ORIGIN) * _FACING
        glass = (data.xpos[self._glasses] - _ORIGIN) * _FACING
        axis = data.xmat[self._glasses, 2::3] * _FACING
        angles = data.qpos[self.angle_at]
        velocities = (angles - before) / CONTROL_TIMESTEP
        return SceneState(angles, velocities, wrist, grip, mouth, glass, axis)

    def _update_grips(self, before: SceneState) -> None:
        """Lets each hand take hold or let go, from how grip and glass stand and have moved."""
        now = self.scene_state
        reach = now.grip - now.glass
        carried = now.glass - before.glass
        moved = np.where(self._held()[:, None], carried, now.grip - before.grip - carried)
        self._velocity += SMOOTHING * (moved / CONTROL_TIMESTEP - self._velocity)
        for row, grip in enumerate(self.grips):
            was_held = grip.held
            grip.update(
                distance=_distance_to_stretch(reach[row], now.axis[row]),
                slip=self._slip(row) if was_held else 0.0,
                speed=_norm(self._velocity[row]),
                height=_bottom(now.glass[row], now.axis[row]),
            )
            if grip.held and not was_held:
                self._weld(row)
            self.data.eq_active[self._holds[row]] = grip.held

    def _held(self) -> np.ndarray:
        """Which hands hold their glass (2,) bool."""
        return np.array([grip.held for grip in self.grips])

    def _weld(self, row: int) -> None:
        """Fixes the glass in the hand as they stand to one another now."""
        data, arm, glass = self.data, self._forearms[row], self._glasses[row]
        inverse, turn = np.empty(4), np.empty(4)
        mju_negQuat(inverse, data.xquat[arm])
        mju_mulQuat(turn, inverse, data.xquat[glass])
        offset = np.empty(3)
        mju_rotVecQuat(offset, data.xpos[glass] - data.xpos[arm], inverse)
        self.model.eq_data[self._holds[row], :10] = (0.0, 0.0, 0.0, *offset, *turn)

    def _slip(self, row: int) -> float:
        """How far the glass is from where the hand took it [m]."""
        data, arm = self.data, self._forearms[row]
        place = np.empty(3)
        mju_rotVecQuat(place, self.model.eq_data[self._holds[row], 3:6], data.xquat[arm])
        return _norm(data.xpos[self._glasses[row]] - data.xpos[arm] - place)


def _norm(vector: np.ndarray) -> float:
    """Length of a 3-vector; `np.linalg.norm` takes ten times as long."""
    return float(vector @ vector) ** 0.5


def _distance_to_stretch(reach: np.ndarray, axis: np.ndarray) -> float:
    """Distance [m] of a grip, `reach` from the glass's middle, from where it can be taken."""
    along = float(reach @ axis)
    nearest = min(max(along, GRIP_HEIGHT - GRIP_STRETCH), GRIP_HEIGHT + GRIP_STRETCH)
    return _norm(reach - nearest * axis)


def _bottom(glass: np.ndarray, axis: np.ndarray) -> float:
    """Height of the middle of a glass's bottom above the table [m]."""
    return float(glass[2] - axis[2] * GLASS_HEIGHT / 2 - (GLASS_REST_Z - GLASS_HEIGHT / 2))
