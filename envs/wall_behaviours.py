"""Built-in behaviours of robots: follow a wall, follow another robot, wander around obstacles.

Each behaviour turns percepts into wheel speeds [m/s]. Maistros, Marom & Hayes (2001), Experiment 2:
the teacher follows walls; the learner can follow the teacher, and wanders by default.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from envs.khepera import WHEEL_BASE, wheel_speeds

Side = Literal["left", "right"]
CRUISE = 0.06  # [m/s] speed of teacher and wanderer
MAX_TURN = 1.8  # [rad/s]

SIDE_TARGET, DIAGONAL_TARGET = 0.58, 0.2  # readings at ±90° and ±45° of a robot along a wall
FRONT_LIMIT = 0.35  # reading at ±12° above which the teacher turns in place
_SIDE_GAIN, _DIAGONAL_GAIN, _FRONT_GAIN = 2.2, 2.5, 6.0  # [rad/s] per unit of reading
_SOMETHING = 0.06  # least reading that is not noise
_SEARCH_AFTER = 30  # [steps] without a reading; rounding a wall's end takes 25
_MAX_TURN_IN = 1.26  # [rad/s] towards the wall: rounds an edge at 4.8 cm

DRIVING, RESTING = 106, 600  # [steps] of a teacher that rests, in turn

GAP = 0.13  # [m] along the trail between the teacher and its follower
WALL_DISTANCE = 0.026  # [m] from the rim, at which a wall follower stays
_LOOK_AHEAD = 0.02  # [m] along the trail
_CRUMB = 0.004  # [m] between two points of the trail

AVOID_FRONT, AVOID_DIAGONAL = 0.5, 0.8  # readings above which a wanderer turns away
_AVOID_SPEED = 0.012  # [m/s] while it does
_MEAN_RUN = 8  # [steps] for which a wanderer holds a turn


class WallFollower:
    """Follows a wall on one side by proportional control on the readings of that side.

    After it has seen nothing for longer than it takes to round a wall's end, it drives straight
    until it meets a wall.

    Args:
        side: Of the wall.
    """

    rests = False  # always

    def __init__(self, side: Side) -> None:
        self.side: Side = side
        self._unseen = _SEARCH_AFTER  # [steps] since it saw anything

    def act(self, infrared: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return wheel speeds `[2]` [m/s] for six readings `[6]`, left to right."""
        self._unseen = 0 if max(infrared) > _SOMETHING else self._unseen + 1
        if self._unseen >= _SEARCH_AFTER:
            return wheel_speeds(CRUISE, 0.0)
        to_the_wall = 1.0 if self.side == "left" else -1.0
        beside, diagonal, *front = infrared[:4] if self.side == "left" else infrared[:1:-1]
        ahead = max(front)
        if ahead > FRONT_LIMIT:
            return wheel_speeds(0.0, -to_the_wall * MAX_TURN)
        turn = (
            _SIDE_GAIN * (SIDE_TARGET - beside)
            + _DIAGONAL_GAIN * (DIAGONAL_TARGET - diagonal)
            - _FRONT_GAIN * ahead
        )
        turn = np.minimum(np.maximum(turn, -MAX_TURN), _MAX_TURN_IN)
        return wheel_speeds(CRUISE, to_the_wall * float(turn))


class RestingFollower(WallFollower):
    """Follows a wall and stops for a minute now and then: it rests 85 % of the time."""

    def __init__(self, side: Side) -> None:
        super().__init__(side)
        self._steps = 0

    @property
    def rests(self) -> bool:
        """Whether it stands still in the next step."""
        return self._steps % (DRIVING + RESTING) >= DRIVING

    def act(self, infrared: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return wheel speeds `[2]` [m/s] for six readings `[6]`, left to right."""
        rests = self.rests
        self._steps += 1
        return np.zeros(2) if rests else super().act(infrared)


class TrailFollower:
    """Follows the trail of another robot at a distance along it.

    Args:
        own_place: Where the follower is `[2]` [m].
        leader_place: Where the other robot is `[2]` [m]; the trail begins as the line between them.
    """

    def __init__(self, own_place: NDArray[np.float64], leader_place: NDArray[np.float64]) -> None:
        steps = max(2, math.ceil(float(np.linalg.norm(leader_place - own_place)) / _CRUMB))
        self._trail = list(np.linspace(own_place, leader_place, steps))

    def act(
        self, pose: NDArray[np.float64], leader_place: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return wheel speeds `[2]` [m/s].

        Args:
            pose: Of the follower `[3]` [m, m, rad].
            leader_place: Where the other robot is now `[2]` [m].
        """
        if np.linalg.norm(leader_place - self._trail[-1]) >= _CRUMB:
            self._trail.append(leader_place.copy())
        trail = np.array(self._trail)
        nearest = int(np.linalg.norm(trail - pose[:2], axis=1).argmin())
        self._trail, trail = self._trail[nearest:], trail[nearest:]
        along = np.concatenate([[0.0], np.linalg.norm(np.diff(trail, axis=0), axis=1).cumsum()])
        goal = trail[min(int(np.searchsorted(along, _LOOK_AHEAD)), len(trail) - 1)]
        return _pursue(pose, goal, speed=CRUISE + 0.5 * (along[-1] - GAP))


class Wanderer:
    """Holds a turn, mostly a gentle one, for a while; turns away from obstacles.

    A run ends at each step with the same probability. The next turn is the largest one times the
    cube of a uniform number, so sharp turns are rare but occur for a forward model to learn.

    Args:
        rng: Of its turns.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._turn = 0.0  # [rad/s]
        self._away = 0.0  # [rad/s] while it turns away, else 0

    def take_over(self, wheels: NDArray[np.floating]) -> None:
        """Continue the present motion as the wanderer's own run.

        Args:
            wheels: Present speeds `[2]` [m/s].
        """
        self._turn = float(wheels[1] - wheels[0]) / WHEEL_BASE
        self._away = 0.0

    def act(self, infrared: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return wheel speeds `[2]` [m/s] for six readings `[6]`, left to right."""
        ends, way = self._rng.random(), self._rng.uniform(-1, 1)
        if ends < 1 / _MEAN_RUN:
            self._turn = MAX_TURN * way**3
        front, diagonal = max(infrared[2:4]), max(infrared[1], infrared[4])
        if front <= AVOID_FRONT and diagonal <= AVOID_DIAGONAL:
            self._away = 0.0
            return wheel_speeds(CRUISE, self._turn)
        if self._away == 0.0:  # chosen once, so that it does not oscillate in a corner
            self._away = MAX_TURN if infrared[3:].sum() > infrared[:3].sum() else -MAX_TURN
        self._turn = 0.0
        return wheel_speeds(_AVOID_SPEED, self._away)


def _pursue(
    pose: NDArray[np.float64], goal: NDArray[np.float64], speed: float
) -> NDArray[np.float64]:
    """Return wheel speeds `[2]` [m/s] on the circle through a goal ahead (pure pursuit)."""
    away = goal - pose[:2]
    bearing = math.remainder(math.atan2(away[1], away[0]) - pose[2], math.tau)
    distance = max(float(np.linalg.norm(away)), 1e-3)
    forwards = max(math.cos(bearing), 0.0)
    turn = (
        2 * CRUISE * math.sin(bearing) / distance if forwards else math.copysign(MAX_TURN, bearing)
    )
    return wheel_speeds(
        float(np.clip(speed, 0.0, 1.4 * CRUISE)) * forwards,
        float(np.clip(turn, -MAX_TURN, MAX_TURN)),
    )
