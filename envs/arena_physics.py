"""The simulated arena behind named queries: poses, infra-red readings, contacts, nearest wall."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from dm_control import mujoco
from numpy.typing import NDArray

from envs.arena import Arena
from envs.arena_scene import N_SUBSTEPS, build_scene
from envs.khepera import INFRARED_NAMES, RADIUS, RAY_ANGLES, infrared
from envs.substeps import run_substeps

_ACTUATORS = 3  # of a robot: left wheel, right wheel, lateral


class NearestWall(NamedTuple):
    """The wall nearest to a robot."""

    distance: float  # [m] from its rim
    direction: NDArray[np.float64]  # [2] from the robot to the wall, of length one


class ArenaPhysics(mujoco.Physics):
    """Robots in an arena; row r of every query is robot r."""

    arena: Arena
    robots: tuple[str, ...]
    _hulls: list[int]  # geom of each robot

    @classmethod
    def build(cls, arena: Arena, robots: tuple[str, ...]) -> ArenaPhysics:
        """Compile the scene.

        Args:
            arena: To build.
            robots: Their names.
        """
        physics = cls.from_xml_string(build_scene(arena, robots))
        physics.arena, physics.robots = arena, robots
        rays = len(robots) * len(INFRARED_NAMES) * len(RAY_ANGLES)
        assert physics.model.nu == _ACTUATORS * len(robots)
        assert physics.model.nsensordata == rays
        physics._hulls = [int(physics.model.name2id(f"{name}/hull", "geom")) for name in robots]
        return physics

    def begin(self, poses: NDArray[np.float64]) -> None:
        """Put the robots at rest.

        Args:
            poses: x, y and heading of each `[R, 3]` [m, m, rad].
        """
        with self.reset_context():
            self.data.qpos[:] = poses.ravel()

    def advance(self, wheels: NDArray[np.float64]) -> None:
        """Run one control step.

        Args:
            wheels: Speeds of each robot's left and right wheel `[R, 2]` [m/s].
        """
        self.data.ctrl.reshape(-1, _ACTUATORS)[:, :2] = wheels
        run_substeps(self, N_SUBSTEPS)

    @property
    def poses(self) -> NDArray[np.float64]:
        """Return x, y and heading of each robot `[R, 3]` [m, m, rad]."""
        return self.data.qpos.reshape(-1, 3).copy()

    def infrared(self, robot: int) -> NDArray[np.float64]:
        """Return a robot's six readings without noise `[6]` in [0, 1]."""
        shape = (len(self.robots), len(INFRARED_NAMES), len(RAY_ANGLES))
        return infrared(self.data.sensordata.reshape(shape)[robot])

    def touches(self, robot: int) -> bool:
        """Return whether a robot touches anything."""
        data, hull = self.data.ptr, self._hulls[robot]
        return data.ncon > 0 and bool((data.contact.geom == hull).any())

    def nearest_wall(self, robot: int) -> NearestWall:
        """Return the wall nearest to a robot."""
        place = self.data.qpos[3 * robot : 3 * robot + 2]
        away = self.arena.nearest_wall(place[None])[0]
        distance = math.sqrt(away.dot(away))
        return NearestWall(distance - RADIUS, away / distance)
