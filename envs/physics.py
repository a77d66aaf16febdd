"""The simulated scene with named queries, for both bodies at once, each in its own frame.

Row 0 is the demonstrator, row 1 the imitator. A body frame has its origin at the pelvis, x
forwards, y to the left, z up. Indices are looked up once; no Python runs in the substeps.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from dm_control import mujoco
from mujoco import mju_mulQuat, mju_negQuat, mju_rotVecQuat  # pyright: ignore[reportAttributeAccessIssue]

from envs import scene
from envs.grip import Grip
from envs.humanoid import JOINTS
from envs.scene import (
    CONTROL_TIMESTEP,
    DEMONSTRATOR,
    GLASS_HEIGHT,
    GLASS_REST_Z,
    GRIP_HEIGHT,
    GRIP_STRETCH,
    N_SUBSTEPS,
    ROOT_DISTANCE,
    ROOT_HEIGHT,
    WHO,
)
from envs.substeps import run_substeps

SMOOTHING = 0.25  # per control step, of the velocity that decides about a grip

_ORIGIN = np.array([[-ROOT_DISTANCE / 2, 0, ROOT_HEIGHT], [ROOT_DISTANCE / 2, 0, ROOT_HEIGHT]])
_FACING = np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0]])  # half a turn about z is its own inverse
# Three times, for the three sites: numpy is twice as slow for different shapes.
_ORIGINS, _FACINGS = np.stack([_ORIGIN] * 3), np.stack([_FACING] * 3)
_TURN = np.repeat(_FACING[1, :, None], 3, axis=1)  # of a rotation of the imitator's


class SceneState(NamedTuple):
    """The state of both bodies and glasses, each in its own body frame."""

    angles: np.ndarray  # [2, 11] [rad]
    velocities: np.ndarray  # [2, 11] [rad/s] mean over the last control step
    wrist: np.ndarray  # [2, 3] [m]
    grip: np.ndarray  # [2, 3] [m]
    mouth: np.ndarray  # [2, 3] [m]
    hand: np.ndarray  # [3, 3] rotation of the imitator's right hand, the grip's frame
    glass: np.ndarray  # [2, 3] [m] the glass's middle
    axis: np.ndarray  # [2, 3] the glass's axis, of length one


class Physics(mujoco.Physics):
    """Two humanoids, a table and two glasses."""

    @classmethod
    def build(cls) -> "Physics":
        """Compile the scene."""
        model = scene.build_scene()
        physics = cls.from_xml_string(model.to_xml_string(), model.get_assets())
        physics._look_up()
        return physics

    def _look_up(self) -> None:
        """Look up every index once, rows as in `WHO`."""
        model = self.model

        def ids(kind: str, *names: str) -> np.ndarray:
            return np.array([model.name2id(name, kind) for name in names])

        joints = ids("joint", *(f"{who}/{joint}" for who in WHO for joint in JOINTS))
        self.angle_at = model.jnt_qposadr[joints].reshape(2, -1)  # [2, 11] into qpos
        self.velocity_at = model.jnt_dofadr[joints].reshape(2, -1)  # [2, 11] into qvel
        self.camera = int(model.name2id(scene.CAMERA, "camera"))
        self.joint_range = model.jnt_range[joints[: len(JOINTS)]].copy()  # [11, 2] [rad]
        sites = ids("site", *(f"{who}/{s}" for s in ("wrist", "grip", "mouth") for who in WHO))
        self._forearms = ids("body", *(f"{who}/rradius" for who in WHO))
        self._glasses = ids("body", *(f"{who}_glass" for who in WHO))
        self._holds = ids("equality", *(f"{who}_grip" for who in WHO)).tolist()
        self._site_at = _flat(sites, 3, (0, 1, 2)).reshape(3, 2, 3)  # into site_xpos
        self._hand_at = _flat(sites[3:4], 9, tuple(range(9))).reshape(3, 3)  # into site_xmat
        self._centre_at = _flat(self._glasses, 3, (0, 1, 2))  # [2, 3] into xpos
        self._axis_at = _flat(self._glasses, 9, (2, 5, 8))  # [2, 3] into xmat
        self._glass_at = model.jnt_qposadr[ids("joint", *(f"{who}_glass" for who in WHO))]
        names = [model.id2name(geom, "geom") for geom in range(model.ngeom)]
        self._is_body = np.array([name.startswith(f"{DEMONSTRATOR}/") for name in names])
        self._is_own_glass = model.geom_bodyid == self._glasses[1]
        self._group = model.geom_group.copy()
        self._collides = model.geom_contype.copy(), model.geom_conaffinity.copy()
        self.grips = (Grip(), Grip())

    def begin(
        self, angles: np.ndarray, glass_place: np.ndarray, own_glass: np.ndarray | None = None
    ) -> None:
        """Start an episode at rest, the glasses standing.

        Args:
            angles: Of both bodies `[2, 11]` [rad].
            glass_place: Where each body's glass stands in its own frame `[2]` [m].
            own_glass: Another pose of the imitator's glass `[7]`, as of `envs.own_glass`.
        """
        with self.reset_context():
            self.data.qpos[self.angle_at] = angles
            standing = np.array([*glass_place, GLASS_REST_Z]) * _FACING + _ORIGIN
            for address, position in zip(self._glass_at, standing, strict=True):
                self.data.qpos[address : address + 3] = position
            if own_glass is not None:
                self._put_own_glass(own_glass)
        # The integral terms start with values that hold the arms against gravity.
        load = self.data.qfrc_bias[self.velocity_at].ravel()
        self.data.act[:] = load / scene.integral_gains()
        self.grips = (Grip(), Grip())
        self._velocity = np.zeros((2, 3))  # [m/s] of the grip at the glass, smoothed
        self.scene_state = self._read(angles)

    def _put_own_glass(self, pose: np.ndarray) -> None:
        """Put the imitator's glass into a pose `[7]` in its body frame."""
        position = pose[:3] * _FACING[1] + _ORIGIN[1]
        turn = pose[3:] * (1.0, *_FACING[1])  # half a turn about z from both sides
        address = self._glass_at[1]
        self.data.qpos[address : address + 7] = (*position, *turn)

    def stage(self, *, demonstrator: bool, own_glass: bool) -> None:
        """Say whether there is a demonstrator, and a glass of the imitator's.

        What is not there is not drawn, and nothing touches a body that is not there. Its stool and
        its glass stay.
        """
        is_away = self._is_body & (not demonstrator) | self._is_own_glass & (not own_glass)
        self.model.geom_group[:] = np.where(is_away, scene.HIDDEN_GROUP, self._group)
        collides = demonstrator | ~self._is_body
        self.model.geom_contype[:] = collides * self._collides[0]
        self.model.geom_conaffinity[:] = collides * self._collides[1]

    def advance(self, targets: Sequence[np.ndarray]) -> None:
        """Run one control step of `CONTROL_TIMESTEP`.

        Args:
            targets: Joint angles of each body `[11]` [rad].
        """
        np.concatenate(targets, out=self.data.ptr.ctrl)
        run_substeps(self, N_SUBSTEPS)
        before, self.scene_state = self.scene_state, self._read(self.scene_state.angles)
        self._update_grips(before)

    def release(self, row: int) -> None:
        """Make a hand let go of its glass."""
        self.grips[row].release()
        self.data.eq_active[self._holds[row]] = 0

    def _read(self, before: np.ndarray) -> SceneState:
        """Return the state; `before` are the angles one control step ago. No array is shared."""
        data = self.data.ptr
        sites = (data.site_xpos.take(self._site_at) - _ORIGINS) * _FACINGS
        hand = data.site_xmat.take(self._hand_at) * _TURN
        glass = (data.xpos.take(self._centre_at) - _ORIGIN) * _FACING
        axis = data.xmat.take(self._axis_at) * _FACING
        angles = data.qpos.take(self.angle_at)
        velocities = (angles - before) / CONTROL_TIMESTEP
        return SceneState(angles, velocities, sites[0], sites[1], sites[2], hand, glass, axis)

    def _update_grips(self, before: SceneState) -> None:
        """Let each hand take hold or let go, by the positions and velocities of grip and glass."""
        now = self.scene_state
        self._smooth(before, now)
        # Lists from here on: numpy is slower for three numbers.
        reach, axes = (now.grip - now.glass).tolist(), now.axis.tolist()
        velocities, heights = self._velocity.tolist(), now.glass[:, 2].tolist()
        slips = self._slips() if any(grip.held for grip in self.grips) else {}
        for row, (grip, hold) in enumerate(zip(self.grips, self._holds, strict=True)):
            was_held = grip.held
            grip.update(
                distance=_distance_to_stretch(reach[row], axes[row]),
                slip=slips.get(hold, math.inf) if was_held else 0.0,
                speed=math.hypot(*velocities[row]),
                height=_bottom(heights[row], axes[row]),
            )
            if grip.held and not was_held:
                self._weld(row)
            if grip.held != was_held:
                self.data.eq_active[hold] = grip.held

    def _smooth(self, before: SceneState, now: SceneState) -> None:
        """Smooth the velocities: of a held glass, else of the grip relative to the glass."""
        carried = now.glass - before.glass
        moved = now.grip - before.grip - carried
        for row, grip in enumerate(self.grips):
            if grip.held:
                moved[row] = carried[row]
        self._velocity += SMOOTHING * (moved / CONTROL_TIMESTEP - self._velocity)

    def _weld(self, row: int) -> None:
        """Fix the glass in the hand at their current relative pose."""
        data, arm, glass = self.data, self._forearms[row], self._glasses[row]
        inverse, turn = np.empty(4), np.empty(4)
        mju_negQuat(inverse, data.xquat[arm])
        mju_mulQuat(turn, inverse, data.xquat[glass])
        offset = np.empty(3)
        mju_rotVecQuat(offset, data.xpos[glass] - data.xpos[arm], inverse)
        self.model.eq_data[self._holds[row], :10] = (0.0, 0.0, 0.0, *offset, *turn)

    def _slips(self) -> dict[int, float]:
        """Return weld -> distance of a held glass from where it was taken [m], the weld's error."""
        data = self.data.ptr
        welds = data.efc_id[: data.ne : 6].tolist()
        errors = data.efc_pos[: data.ne].tolist()  # of each weld along three axes [m], then turns
        return {weld: math.hypot(*errors[6 * i : 6 * i + 3]) for i, weld in enumerate(welds)}


def _flat(rows: np.ndarray, width: int, columns: tuple[int, ...]) -> np.ndarray:
    """Return indices `[R, C]` of columns of rows `[R]` in a flattened array of that width."""
    return width * rows[:, None] + np.array(columns)


def _distance_to_stretch(reach: list[float], axis: list[float]) -> float:
    """Return the distance [m] of a grip, `reach` from the glass, from where it fits a hand."""
    along = reach[0] * axis[0] + reach[1] * axis[1] + reach[2] * axis[2]
    nearest = min(max(along, GRIP_HEIGHT - GRIP_STRETCH), GRIP_HEIGHT + GRIP_STRETCH)
    return math.dist(reach, [nearest * a for a in axis])


def _bottom(height: float, axis: list[float]) -> float:
    """Return the height [m] of a glass's bottom above the table, from that of its middle."""
    return height - axis[2] * GLASS_HEIGHT / 2 - (GLASS_REST_Z - GLASS_HEIGHT / 2)
