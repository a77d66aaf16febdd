"""Initial poses of robots: in the open, one behind another in the open, or beside a wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from envs.arena import Arena
from envs.khepera import RADIUS
from envs.wall_behaviours import GAP, WALL_DISTANCE, Side

OPEN_CLEARANCE = 0.06  # [m] least distance from the rim to the nearest wall in the open
_TOLERANCE = 0.006  # [m] on the distance of a robot beside a wall
_APPROACH, _GRAZING = 0.07, math.radians(25)  # [m] [rad] of a robot that will meet a wall
_TRIES = 100_000


def open_pose(arena: Arena, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a pose away from walls `[3]` [m, m, rad].

    Args:
        arena: To place them in.
        rng: Of place and heading.
    """
    for _ in range(_TRIES):
        place = rng.uniform(-0.5, 0.5, size=2) * arena.size
        if arena.clearance(place[None])[0] >= RADIUS + OPEN_CLEARANCE:
            return np.array([*place, rng.uniform(-math.pi, math.pi)])
    raise AssertionError(f"no open place in {arena}")


def following_poses(arena: Arena, rng: np.random.Generator, side: Side) -> NDArray[np.float64]:
    """Return poses of a robot and of another straight ahead of it `[2, 3]` [m, m, rad].

    Both are in the open, on the way to a wall that they will meet on the given side.

    Args:
        arena: To place them in.
        rng: Of the place along the walls.
        side: Of the wall that they will meet.
    """
    for _ in range(_TRIES):
        x, y, turn = wall_pose(arena, rng, side, _APPROACH / math.tan(_GRAZING))
        to_the_wall = 1 if side == "left" else -1
        outwards = turn - to_the_wall * math.pi / 2
        start = np.array([x, y]) + _APPROACH * np.array([math.cos(outwards), math.sin(outwards)])
        turn += to_the_wall * _GRAZING
        way = _way(start, np.array([math.cos(turn), math.sin(turn)]), -GAP)
        if (arena.clearance(way) >= RADIUS + OPEN_CLEARANCE).all():
            return np.array([[*way[-1], turn], [*way[0], turn]])
    raise AssertionError(f"no open way to a wall in {arena}")


def wall_pose(
    arena: Arena, rng: np.random.Generator, side: Side, length: float = 0.06
) -> NDArray[np.float64]:
    """Return a pose along a wall, at a wall follower's distance `[3]` [m, m, rad].

    Args:
        arena: To place them in.
        rng: Of the place along the walls.
        side: Of the wall, as the robot sees it.
        length: Length for which the wall continues ahead [m].
    """
    outlines = [obstacle.outline for obstacle in arena.obstacles]
    distance = RADIUS + WALL_DISTANCE
    for _ in range(_TRIES):
        outline = outlines[rng.integers(len(outlines))]
        start = rng.integers(len(outline))
        along = outline[(start + 1) % len(outline)] - outline[start]
        along /= np.linalg.norm(along)
        outwards = np.array([along[1], -along[0]])  # outlines run anticlockwise
        heading = along if side == "left" else -along
        way = _way(outline[start] + distance * outwards, heading, length)
        if (np.abs(arena.clearance(way) - distance) <= _TOLERANCE).all():
            return np.array([*way[0], math.atan2(heading[1], heading[0])])
    raise AssertionError(f"no way along a wall in {arena}")


def _way(
    start: NDArray[np.float64], heading: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
    """Return ten places on a straight way `[10, 2]` [m]."""
    return start + np.linspace(0, length, 10)[:, None] * heading
