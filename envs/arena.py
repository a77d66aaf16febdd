"""Walled arenas: outer walls, inner walls and islands, drawn from a seed or by name.

Maistros, Marom & Hayes (2001), Experiment 2, Figure 8. Every obstacle is a box or a round
pillar; a robot fits between any two that do not touch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

THICKNESS = 0.02  # [m] of a wall
CLEARANCE = 0.28  # [m] least distance of obstacles that do not touch: ten radii of a robot
SIDES = (1.1, 1.5)  # [m] inside a random arena, least and largest
_TRIES = 300  # most attempts to place one obstacle


@dataclass(frozen=True)
class Box:
    """A wall or a rectangular island, seen from above.

    Attributes:
        centre: x and y [m].
        half_size: Along its own two axes [m].
        angle: Of its first axis [rad].
    """

    centre: tuple[float, float]
    half_size: tuple[float, float]
    angle: float = 0.0

    @property
    def corners(self) -> NDArray[np.float64]:
        """Return the corners in order `[4, 2]` [m]."""
        signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        return (signs * self.half_size) @ self.axes + self.centre

    @property
    def outline(self) -> NDArray[np.float64]:
        """Return points around it, at most 1 cm apart `[N, 2]` [m]."""
        corners = self.corners
        sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        return np.concatenate([_between(start, end) for start, end in sides])

    @property
    def axes(self) -> NDArray[np.float64]:
        """Return its two axes in the world as rows `[2, 2]`."""
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        return np.array([[cosine, sine], [-sine, cosine]])


@dataclass(frozen=True)
class Pillar:
    """A round island, seen from above.

    Attributes:
        centre: x and y [m].
        radius: [m].
    """

    centre: tuple[float, float]
    radius: float

    @property
    def outline(self) -> NDArray[np.float64]:
        """Return points around it, at most 1 cm apart `[N, 2]` [m]."""
        count = max(24, math.ceil(2 * math.pi * self.radius / 0.01))
        turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
        return self.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1) + self.centre


_Obstacle = TypeVar("_Obstacle", bound=Box | Pillar)


@dataclass(frozen=True)
class Arena:
    """A rectangle of outer walls around (0, 0) with obstacles in it.

    Attributes:
        size: Inside the outer walls, along x and y [m].
        inner_walls: Walls that touch an outer one, or stand free.
        islands: Obstacles that a robot can go around.
    """

    size: tuple[float, float]
    inner_walls: tuple[Box, ...] = ()
    islands: tuple[Box | Pillar, ...] = ()

    @property
    def outer_walls(self) -> tuple[Box, ...]:
        """Return the four outer walls."""
        half_x, half_y = self.size[0] / 2, self.size[1] / 2
        half = THICKNESS / 2
        along_x, along_y = (half_x + THICKNESS, half), (half, half_y)
        return (
            Box((0.0, half_y + half), along_x),
            Box((0.0, -half_y - half), along_x),
            Box((half_x + half, 0.0), along_y),
            Box((-half_x - half, 0.0), along_y),
        )

    @property
    def obstacles(self) -> tuple[Box | Pillar, ...]:
        """Return everything that a robot can run into."""
        return (*self.outer_walls, *self.inner_walls, *self.islands)

    def nearest(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the nearest point of every obstacle to each of points `[N, 2]`: `[N, O, 2]` [m].

        Boxes come first, then pillars. For a point within an obstacle it is the point itself.
        """
        places = np.asarray(points, dtype=np.float64)[:, None]  # [N, 1, 2]
        centres, axes, half_sizes = self._boxes
        own = _sum_of_pair((places - centres)[..., None, :] * axes)  # [N, B, 2] in own axes
        own = np.minimum(np.maximum(own, -half_sizes), half_sizes)
        on_boxes = own[..., :1] * axes[:, 0] + own[..., 1:] * axes[:, 1] + centres
        centres, radii = self._pillars
        if not len(centres):
            return on_boxes
        away = places - centres
        length = np.sqrt(_sum_of_pair(away * away))[..., None]
        inwards = radii / np.maximum(length, radii)  # 1 within the pillar
        return np.concatenate([on_boxes, centres + away * inwards], axis=1)

    def nearest_wall(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return vectors `[N, 2]` [m] from points `[N, 2]` to the nearest wall point."""
        away = self.nearest(points) - np.asarray(points, dtype=np.float64)[:, None]
        nearest = _sum_of_pair(away * away).argmin(axis=1)
        return away[np.arange(len(away)), nearest]

    def clearance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return distances `[N]` [m] of points `[N, 2]` to the nearest wall; 0 outside."""
        places = np.asarray(points, dtype=np.float64)
        inside = (np.abs(places) < np.array(self.size) / 2).all(axis=1)
        return np.where(inside, np.linalg.norm(self.nearest_wall(places), axis=1), 0.0)

    @cached_property
    def _boxes(self) -> tuple[NDArray[np.float64], ...]:
        """Return centres `[B, 2]`, axes `[B, 2, 2]` and half sizes `[B, 2]` of all boxes."""
        boxes = [obstacle for obstacle in self.obstacles if isinstance(obstacle, Box)]
        return (
            np.array([box.centre for box in boxes]),
            np.stack([box.axes for box in boxes]),
            np.array([box.half_size for box in boxes]),
        )

    @cached_property
    def _pillars(self) -> tuple[NDArray[np.float64], ...]:
        """Return centres `[P, 2]` and radii `[P, 1]` of all pillars."""
        pillars = [obstacle for obstacle in self.obstacles if isinstance(obstacle, Pillar)]
        centres = np.array([pillar.centre for pillar in pillars]).reshape(-1, 2)
        return centres, np.array([pillar.radius for pillar in pillars]).reshape(-1, 1)


def make_arena(which: str | int) -> Arena:
    """Return an arena by name or from a seed.

    Args:
        which: "paper", an arena like the one in the paper, or a seed ≥ 0.

    Raises:
        ValueError: Neither.
    """
    if which == "paper":
        return PAPER_ARENA
    if isinstance(which, int | np.integer) and not isinstance(which, bool) and which >= 0:
        return generate_arena(int(which))
    raise ValueError(f"arena must be 'paper' or a seed ≥ 0, got {which!r}")


def generate_arena(seed: int) -> Arena:
    """Draw an arena: one or two inner walls, one or two islands, each with a way around."""
    rng = np.random.default_rng(seed)
    arena = Arena((_draw(rng, *SIDES), _draw(rng, *SIDES)))
    more_walls, more_islands = rng.integers(0, 2, size=2)
    # One of each first: a second one may not fit.
    for with_wall, with_island in ((1, 1), (more_walls, more_islands)):
        for _ in range(with_wall):
            wall = _first_with_room(arena, _inner_walls(arena, rng), touching=1)
            arena = replace(arena, inner_walls=(*arena.inner_walls, *wall))
        for _ in range(with_island):
            island = _first_with_room(arena, _islands(arena, rng), touching=0)
            arena = replace(arena, islands=(*arena.islands, *island))
    return arena


# Outer walls of 1.2 m, two inner walls that touch different outer ones, and an island.
PAPER_ARENA = Arena(
    size=(1.2, 1.2),
    inner_walls=(
        Box((-0.2, 0.425), (THICKNESS / 2, 0.175)),
        Box((0.425, -0.2), (0.175, THICKNESS / 2)),
    ),
    islands=(Box((-0.17, -0.17), (0.1, 0.1)),),
)


def _first_with_room(
    arena: Arena, candidates: Iterator[_Obstacle], touching: int
) -> tuple[_Obstacle, ...]:
    """Return the first candidate with `CLEARANCE` to all but `touching` obstacles, if any."""
    for candidate in islice(candidates, _TRIES):
        outline = candidate.outline
        gaps = np.linalg.norm(arena.nearest(outline) - outline[:, None], axis=2).min(axis=0)  # [O]
        if (gaps < CLEARANCE).sum() == touching:
            return (candidate,)
    return ()


def _inner_walls(arena: Arena, rng: np.random.Generator) -> Iterator[Box]:
    """Yield walls at a right angle to an outer one, anywhere along it."""
    while True:
        axis, side = rng.integers(2), rng.choice([-1, 1])
        half_length = _draw(rng, 0.12, 0.2)
        centre, half_size = np.zeros(2), np.full(2, THICKNESS / 2)
        centre[axis] = side * (arena.size[axis] / 2 - half_length)
        centre[1 - axis] = _draw(rng, -0.5, 0.5) * arena.size[1 - axis]
        half_size[axis] = half_length
        yield Box((centre[0], centre[1]), (half_size[0], half_size[1]))


def _islands(arena: Arena, rng: np.random.Generator) -> Iterator[Box | Pillar]:
    """Yield boxes at any angle and pillars, anywhere."""
    while True:
        x, y = (_draw(rng, -0.5, 0.5) * side for side in arena.size)
        if rng.random() < 0.5:
            yield Pillar((x, y), _draw(rng, 0.06, 0.12))
        else:
            half_size = (_draw(rng, 0.06, 0.12), _draw(rng, 0.06, 0.12))
            yield Box((x, y), half_size, _draw(rng, 0, math.pi / 2))


def _sum_of_pair(pairs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum over the last axis, of length 2; numpy's `sum` is three times slower."""
    return pairs[..., 0] + pairs[..., 1]


def _between(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    count = max(1, math.ceil(float(np.linalg.norm(end - start)) / 0.01))
    return start + np.linspace(0, 1, count, endpoint=False)[:, None] * (end - start)


def _draw(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))
