"""A kinematic world in which a mug is hung by its handle on a hook, and both are turned.

Places in m, angles in rad, times in s. The mug's handle points to the robot, along −y, where its
yaw is 0; so does the hook where its board's yaw is 0. A hand lags behind commanded velocities. It
pushes the mug away where it runs into it, and does not pass through the board.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.floating]

FPS = 50
SPEED, TURN_SPEED, CLOSING = 0.3, 1.5, 4.0  # at an action of 1 [m/s], [rad/s], [1/s]
LAG = 0.1  # time constant of the hand [s]
HANDLE, BODY, TALL = 0.07, 0.055, 0.12  # of the handle from the mug's axis; the mug's size [m]
HOOK, BOARD = 0.12, 0.08  # of the hook's end from its board; half the board's width [m]
NEAR = 0.02  # of the handle where it is grasped, and of the hook's end where it hangs [m]
ALIGNED = math.radians(20)  # of hand and mug, mug and board, where the hand turns
TURN = math.radians(60)  # the most that mug and board are turned
SQUARE = 0.3  # side of the square in which the mug stands [m]
START, TABLE, HUNG = (0.0, -0.35, 0.25), 0.05, 0.2  # the hand's; heights of mug and hook [m]
MARKS = ("mug", "board")
HELD, OPEN = 0.3, 0.7  # the gripper's opening below which it grasps, above which it lets go


class Variant(NamedTuple):
    """What there is, and how it is perceived."""

    title: str
    dimensions: int
    """Of places, 2 or 3."""
    quaternion: bool
    """Whether orientations are quaternions; angles otherwise."""
    hand_turns: bool
    """Whether the hand has a yaw, which must agree with the mug's and take it to the board's."""

    @property
    def action_names(self) -> tuple[str, ...]:
        """Velocities in shares of the fastest, then the gripper's: 1 closes it, −1 opens it."""
        yaw = ("yaw",) if self.hand_turns else ()
        return (*self._axes, *yaw, "gripper")

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the percept's first dimensions, the robot's own."""
        yaw = ("hand.yaw",) if self.hand_turns else ()
        return (*[f"hand.{axis}" for axis in self._axes], *yaw, "gripper")

    @property
    def percept_names(self) -> tuple[str, ...]:
        """Names of all dimensions of a percept."""
        turn = ("qw", "qx", "qy", "qz") if self.quaternion else ("yaw",)
        poses = [f"{name}.{part}" for name in MARKS for part in (*self._axes, *turn)]
        return (*self.state_names, *poses)

    @property
    def _axes(self) -> str:
        return "xyz"[: self.dimensions]


VARIANTS = {
    "space": Variant("in space, quaternions", 3, quaternion=True, hand_turns=False),
    "plane": Variant("in a plane, angles", 2, quaternion=False, hand_turns=False),
    "hand": Variant("in space, the hand turns too", 3, quaternion=False, hand_turns=True),
}


class World:
    """One scene.

    Args:
        variant: of it.
        random: where things stand and how they are turned.

    Attributes:
        hand: place and yaw, `[4]`.
        opening: of the gripper, 0 to 1.
        mug: place and yaw, `[4]`.
        board: place and yaw, `[4]`; the hook is in front of it.
        is_held: whether the hand holds the mug.
        was_held: whether it has ever held it.
    """

    def __init__(self, variant: Variant, random: np.random.Generator) -> None:
        self.variant = variant
        flat = variant.dimensions == 2
        low, high = (0.0, 0.0) if flat else (TABLE, HUNG)
        self.hand = np.array([*START[:2], 0.0 if flat else START[2], 0.0])
        self.mug = np.array([*random.uniform(-SQUARE / 2, SQUARE / 2, 2), low, 0.0])
        self.board = np.array([random.uniform(-0.3, 0.3), random.uniform(0.35, 0.5), high, 0.0])
        self.mug[3], self.board[3] = random.uniform(-TURN, TURN, 2)
        self.opening, self.is_held = 1.0, False
        self._velocity, self.was_held = np.zeros(4), False
        self._hold = np.zeros(4)  # the mug's pose in the hand's axes

    def step(self, action: Floats) -> None:
        """Move on by a frame, with an action of as many numbers as the variant has names."""
        action, size = np.clip(action, -1, 1), self.variant.dimensions
        commanded = np.zeros(4)
        commanded[:size] = SPEED * action[:size]
        if self.variant.hand_turns:
            commanded[3] = TURN_SPEED * action[3]
        self._velocity += (commanded - self._velocity) * (1 - math.exp(-1 / (LAG * FPS)))
        new = self.hand + self._velocity / FPS
        if self._is_blocked(new):
            self._velocity[:3], new[:3] = 0.0, self.hand[:3]
        self.hand = new
        before = self.opening
        self.opening = float(np.clip(before - CLOSING / FPS * action[-1], 0, 1))
        self._grasp(closes=before >= HELD > self.opening)
        if self.is_held:
            self.mug = self.hand + np.append(turned(self._hold[:3], self.hand[3]), self._hold[3])
        else:
            self._push()

    def percept(self) -> NDArray[np.float32]:
        """Return the hand, the gripper's opening, and the mug and the board, `[D]`."""
        size = self.variant.dimensions
        own = [*self.hand[:size], *([self.hand[3]] if self.variant.hand_turns else [])]
        parts = [own, [self.opening]]
        for pose in (self.mug, self.board):
            half = pose[3] / 2
            turn = [math.cos(half), 0, 0, math.sin(half)] if self.variant.quaternion else [pose[3]]
            parts += [pose[:size], turn]
        return np.concatenate(parts).astype(np.float32)

    @property
    def handle(self) -> Array:
        """Where the mug's handle is, `[3]`."""
        return in_front(self.mug, HANDLE)

    @property
    def hangs(self) -> bool:
        """Whether the mug hangs on the hook, let go of."""
        near = np.linalg.norm(self.handle - in_front(self.board, HOOK)) < NEAR
        right = not self.variant.hand_turns or apart(self.mug[3], self.board[3]) < ALIGNED
        return bool(self.was_held and not self.is_held and near and right)

    def _grasp(self, *, closes: bool) -> None:
        """Hold the mug or let it go, as the gripper closes or has opened."""
        if self.is_held:
            self.is_held = self.opening < OPEN
            return
        near = np.linalg.norm(self.hand[:3] - self.handle) < NEAR
        right = not self.variant.hand_turns or apart(self.hand[3], self.mug[3]) < ALIGNED
        if closes and near and right:
            self.is_held = self.was_held = True
            self._hold = self.mug - self.hand
            self._hold[:3] = turned(self._hold[:3], -self.hand[3])

    def _push(self) -> None:
        """Move the mug out of the hand's way."""
        way = self.mug[:2] - self.hand[:2]
        distance = float(np.linalg.norm(way))
        if distance < BODY and self.hand[2] < TALL:
            self.mug[:2] = self.hand[:2] + way / max(distance, 1e-9) * BODY

    def _is_blocked(self, new: Array) -> bool:
        """Return whether the board is between the hand and a new place of it."""
        before, after = (
            turned(place[:3] - self.board[:3], -self.board[3]) for place in (self.hand, new)
        )
        return bool(before[1] * after[1] <= 0 and abs(after[0]) < BOARD)


def turned(vector: Floats, yaw: float) -> Array:
    """Return vectors `[..., 2 or 3]` turned about the last axis of space."""
    c, s = math.cos(yaw), math.sin(yaw)
    vector = vector.astype(np.float64)
    x, y = vector[..., 0], vector[..., 1]
    return np.concatenate(
        [np.stack([c * x - s * y, s * x + c * y], axis=-1), vector[..., 2:]], axis=-1
    )


def in_front(pose: Array, distance: float) -> Array:
    """Return the place `[3]` at a distance from a pose, towards where it points."""
    return pose[:3] + turned(np.array([0.0, -distance, 0.0]), pose[3])


def apart(one: float, other: float) -> float:
    """Return by how much two angles differ, 0 to π."""
    return abs(math.remainder(one - other, 2 * math.pi))
