"""Where robots begin: in the open, beside a wall, or one behind another along a wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from envs.arena import Arena
from envs.khepera import RADIUS
from envs.wall_behaviours import GAP, WALL_DISTANCE, Side

OPEN_CLEARANCE = 0.06  # [m] from the rim to the nearest wall of a robot in the open
_TOLERANCE = 0.006  # [m] by which a robot beside a wall may be nearer or farther
_TRIES = 100_000


def open_pose(arena: Arena, rng: np.random.Generator) -> NDArray[np.float64]:
    """A pose away from walls (3,) [m, m, rad].

    Args:
        arena: where.
        rng: of place and heading.
    """
    for _ in range(_TRIES):
        place = rng.uniform(-0.5, 0.5, size=2) * arena.size
        if arena.clearance(place[None])[0] >= RADIUS + OPEN_CLEARANCE:
            return np.array([*place, rng.uniform(-math.pi, math.pi)])
    raise AssertionError(f"no open place in {arena}")


def wall_pose(arena: Arena, rng: np.random.Generator, side: Side) -> NDArray[np.float64]:
    """A pose along a wall, at the distance that a wall follower keeps (3,) [m, m, rad].

    Args:
        arena: where.
        rng: of the place along the walls.
        side: of the wall, as the robot sees it.
    """
    return following_poses(arena, rng, side, gap=0.0)[0]


def following_poses(
    arena: Arena, rng: np.random.Generator, side: Side, gap: float = GAP
) -> NDArray[np.float64]:
    """Poses of a robot along a wall and of another ahead of it along the same wall (2, 3).

    Args:
        arena: where.
        rng: of the place along the walls.
        side: of the wall, as the robots see it.
        gap: between their centres [m].
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
        place = outline[start] + distance * outwards
        way = place + np.linspace(0, gap, 10)[:, None] * heading
        if (np.abs(arena.clearance(way) - distance) <= _TOLERANCE).all():
            turn = math.atan2(heading[1], heading[0])
            return np.array([[*place, turn], [*way[-1], turn]])
    raise AssertionError(f"no way along a wall in {arena}")
