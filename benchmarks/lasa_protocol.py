"""A closed loop in which a point follows a learner's actions, and how its path is scored.

Places in mm, times in s. The point starts where a drawing starts that the learner has not seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol, get_args

import numpy as np

from benchmarks.lasa_data import Array, Drawing, Places, interpolate, lengths

Condition = Literal["undisturbed", "pushed", "blocked"]
CONDITIONS: tuple[Condition, ...] = get_args(Condition)

APPROACH = 0.05  # time constant with which the point approaches the action [s]
PUSH = 10.0  # across its path [mm]
BLOCK = 1.0  # during which it cannot move [s]
ARRIVED = 5.0  # from the end of the drawing [mm]
SLOW, STILL = 0.5, 0.4  # it has stopped once it was slower than this [mm/s] for as long [s]
PATIENCE = 3.0  # without an action, after which it has stalled [s]
LOST = 1e3  # from the origin, beyond which it does not come back [mm]
ALLOWED = 1.5  # time, in lengths of the longest drawing that was shown
POINTS = 500  # of a path that is scored
TREMBLE = 1.0  # around the end, within which what a path does is no part of it [mm]


class Policy(Protocol):
    """Acts on places."""

    @property
    def tolerance(self) -> float:
        """Return the deviation that was novel since `begin`, on average [mm]; NaN for none."""
        ...

    def begin(self, start: Array) -> None:
        """Start anew at a place `[2]`."""
        ...

    def step(self, place: Array) -> Array | None:
        """Return the place to approach `[2]`; None to stay."""
        ...


class Plan(NamedTuple):
    """What happens in a rollout, in steps."""

    hz: float
    """Steps per second [1/s]."""
    steps: int
    """After how many it ends, at the latest."""
    push_at: int = -1
    """The step before which the point is pushed; −1 for none."""
    side: float = 1.0
    """Of the path on which the push ends: 1 for the left, −1 for the right."""
    blocked: range = range(0)
    """The steps in which it cannot move."""
    patience: float = PATIENCE
    """Time without an action after which it ends [s]."""
    near: float = ARRIVED
    """From the goal, within which it ends if the point is still [mm]."""


class Rollout(NamedTuple):
    """What the point did."""

    path: Places
    held: float
    """Share of the steps without an action."""
    tolerance: float
    """As of the policy [mm]."""


class Score(NamedTuple):
    """How good a rollout is."""

    area: float
    """Between its path and the drawing [mm²]."""
    arrived: float
    """1 if it ended near the drawing's end, else 0."""
    held: float
    tolerance: float


class Point:
    """A point that approaches the place it is told, as an overdamped spring does.

    Args:
        start: its place `[2]` [mm].
        hz: steps per second [1/s].
    """

    def __init__(self, start: Array, hz: float) -> None:
        self.place = np.array(start, float)
        self.velocity = np.zeros(2)  # as commanded [mm/s]
        self._dt = 1 / hz

    @property
    def speed(self) -> float:
        """Return how fast it is told to be [mm/s]."""
        return math.hypot(*self.velocity)

    def push(self, side: float) -> None:
        """Move it by `PUSH` across its way, or across the x axis if it has none."""
        x, y = self.velocity / self.speed if self.speed > 1e-6 else (1.0, 0.0)
        self.place = self.place + side * PUSH * np.array([-y, x])

    def move(self, action: Array | None, blocked: bool) -> None:
        """Move it for one step towards the action `[2]`; without one it stays."""
        self.velocity = np.zeros(2) if action is None else (action - self.place) / APPROACH
        if not blocked:
            self.place = self.place + self._dt * self.velocity


def plan_for(condition: Condition, shown: Sequence[Drawing], side: float = 1.0) -> Plan:
    """Return the plan for a learner of these drawings: what disturbs it comes half-way in time."""
    hz, usual = shown[0].hz, max(len(one.places) for one in shown)
    steps, half = round(ALLOWED * usual), round(usual / 2)
    if condition == "pushed":
        return Plan(hz, steps, half, side)
    if condition == "blocked":
        length = round(BLOCK * hz)
        return Plan(hz, steps + length, blocked=range(half, half + length))
    return Plan(hz, steps)


def roll_out(policy: Policy, start: Array, goal: Array, plan: Plan) -> Rollout:
    """Let a policy move the point from a start `[2]` until it stops at a goal `[2]` or stalls."""
    point, path = Point(start, plan.hz), [np.array(start, float)]
    policy.begin(point.place)
    held = waiting = still = steps = 0
    for step in range(plan.steps):
        if step == plan.push_at:
            point.push(plan.side)
            path.append(point.place)
        action = policy.step(point.place)
        point.move(action, step in plan.blocked)
        path.append(point.place)
        steps, held = steps + 1, held + (action is None)
        waiting = waiting + 1 if action is None else 0
        still = still + 1 if point.speed < SLOW else 0
        undisturbed = step >= max(plan.push_at, plan.blocked.stop)
        if undisturbed and _is_over(point.place, goal, waiting, still, plan):
            break
    return Rollout(np.array(path), held / max(1, steps), policy.tolerance)


def _is_over(place: Array, goal: Array, waiting: int, still: int, plan: Plan) -> bool:
    """Return whether it stopped at the goal `[2]`, stalled or was lost.

    Args:
        place: where it is `[2]` [mm].
        goal: where it has to stop `[2]` [mm].
        waiting: steps without an action until now.
        still: steps for which it has been slow until now.
        plan: of the rollout.
    """
    stopped = still >= STILL * plan.hz and math.dist(place, goal) < plan.near
    return stopped or waiting >= plan.patience * plan.hz or math.hypot(*place) > LOST


def score(rollout: Rollout, drawn: Drawing) -> Score:
    """Compare a rollout with the drawing from whose start it began."""
    goal = drawn.places[-1]
    near = math.dist(rollout.path[-1], goal) < ARRIVED
    area = swept_area(without_tremble(rollout.path, goal), drawn.places)
    return Score(area, float(near), rollout.held, rollout.tolerance)


def resample(path: Places, points: int = POINTS) -> Places:
    """Return points at equal distances along a path `[points, 2]`."""
    along = lengths(path)
    return interpolate(np.linspace(0, along[-1], points), along, path)


def swept_area(one: Places, other: Places) -> float:
    """Return the area between two paths [mm²]: that of the tetragons between their points.

    It is the swept error area of Khansari-Zadeh & Billard, "Learning control Lyapunov function to
    ensure stability of dynamical system-based robot reaching motions", 2014. Of a tetragon that
    crosses itself only the difference of its two parts counts.
    """
    a, b = resample(one), resample(other)
    (x, y), (u, v) = (b[1:] - a[:-1]).T, (b[:-1] - a[1:]).T  # the diagonals
    return float(np.abs(x * v - y * u).sum() / 2)


def without_tremble(path: Places, goal: Array) -> Places:
    """Return a path up to where it came within `TREMBLE` of the goal `[2]` for the last time.

    A path that ends elsewhere is returned as it is.
    """
    outside = np.flatnonzero(np.hypot(*(path - goal).T) >= TREMBLE)
    last = outside[-1] if len(outside) else -1
    return path if last == len(path) - 1 else path[: last + 2]
