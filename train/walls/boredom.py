"""Boredom: a robot that has perceived nothing new for a while turns away and goes straight on.

It is part of the default behaviour of everyone who acts alone, whatever drives the robot otherwise.
Maistros, Marom & Hayes (2001) let novelty decide what is learned by habituation; here it decides
when to go elsewhere.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from envs.arena_scene import CONTROL_TIMESTEP
from envs.khepera import wheel_speeds
from envs.wall_behaviours import CRUISE, MAX_TURN
from train.walls.drivers import Driven, Driver, shares

PATIENCE = 3000  # [steps] with walls on the same side alone: five minutes
BLIND = 30  # [steps] without a wall; rounding a wall's end takes 25
SEEN = 0.1  # reading of a wall some 50 mm away
TURN = math.radians(120)  # away from the wall
TURNING = round(TURN / (MAX_TURN * CONTROL_TIMESTEP))  # [steps]


class Boredom:
    """Says when a robot is bored, and drives it until it sees the next wall.

    It is bored once the walls that it saw were on the same side for `PATIENCE` steps: it turns away
    from them in place, and drives straight on. It is also bored once it has seen nothing for
    `BLIND` steps: it drives straight on.
    """

    def __init__(self) -> None:
        self._side = 0  # of the walls: 1 left, -1 right, 0 none so far
        self._same = 0  # [steps] for which they were on that side
        self._unseen = 0  # [steps]
        self._turns = 0  # [steps] still to turn away

    def drive(self, percept: NDArray[np.floating]) -> NDArray[np.float64] | None:
        """Return wheel speeds `[2]` [m/s] for six readings `[6]`; None unless it is bored."""
        if self._turns:
            self._turns -= 1
            return wheel_speeds(0.0, -self._side * MAX_TURN)
        self._notice(percept)
        if self._same >= PATIENCE:
            self._same, self._unseen, self._turns = 0, BLIND, TURNING - 1
            return wheel_speeds(0.0, -self._side * MAX_TURN)
        return wheel_speeds(CRUISE, 0.0) if self._unseen >= BLIND else None

    def _notice(self, percept: NDArray[np.floating]) -> None:
        """Count the steps without a wall, and with walls on one side."""
        if max(percept) <= SEEN:
            self._unseen += 1
            return
        side = 1 if percept[:3].sum() > percept[3:].sum() else -1
        self._same = self._same + 1 if side == self._side else 1
        self._side, self._unseen = side, 0


class Bored:
    """Drive as another driver, but for the moments of boredom.

    Args:
        driver: Of the robot while it is not bored.
    """

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self._boredom = Boredom()

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        wheels = self._boredom.drive(percept)
        return self._driver.drive(percept) if wheels is None else Driven(shares(wheels))
