"""A small world for tests of bodies: an arm of four hinges takes an object, and puts it back.

Only joint angles, a gripper's opening and the object are perceived; actions are angles that the
joints follow with a lag. All of it is in metres and seconds, but percepts may be in another unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.kinematics import KinematicModel

Array = NDArray[np.float64]

JOINTS = ("base", "shoulder", "elbow", "wrist")
SHOULDER, UPPER, FORE, HAND = 0.3, 0.3, 0.3, 0.1  # [m], the height of the shoulder, and links
LIMITS = 2.8  # [rad]
LAG = 0.04  # [s] with which joints and gripper follow
GRASP = 0.035  # [m] from the handle within which a gripper that closes takes hold
HANDLE = 0.05  # [m] from the object's middle along its first axis
OPEN, SHUT = 1.0, 0.0

START, MOUTH = (0.25, -0.25, 0.5), (0.2, 0.15, 0.6)
OBJECT = (0.4, 0.1, 0.15)  # of the handle, unless given
BEFORE = 0.12  # [m] from the handle at which the hand arrives and withdraws
TILT = 0.6  # [rad] by which the hand is tilted at the mouth

Seen = Literal["place", "axis", "turn"]


def pose(angles: Array) -> tuple[Array, Array]:
    """Return where the hand is [m], and how it is turned, a rotation matrix."""
    base, *pitches = angles
    heading = Rotation.from_rotvec([0, 0, base])
    ahead, up, pitch = 0.0, SHOULDER, 0.0
    for link, turned in zip((UPPER, FORE, HAND), pitches, strict=True):
        pitch += turned
        ahead, up = ahead + link * math.cos(pitch), up + link * math.sin(pitch)
    place = heading.apply([ahead, 0, up])
    return place, (heading * Rotation.from_rotvec([0, -pitch, 0])).as_matrix()


def posture(place: Sequence[float], pitch: float = 0.0) -> Array:
    """Return the angles that take the hand somewhere, with the elbow up: by trigonometry."""
    x, y, z = place
    ahead = math.hypot(x, y) - HAND * math.cos(pitch)
    up = z - SHOULDER - HAND * math.sin(pitch)
    square = ahead**2 + up**2
    bend = -math.acos((square - UPPER**2 - FORE**2) / (2 * UPPER * FORE))
    lift = math.atan2(up, ahead) - math.atan2(FORE * math.sin(bend), UPPER + FORE * math.cos(bend))
    return np.array([math.atan2(y, x), lift, bend, pitch - lift - bend])


def body(unit: float = 1.0) -> KinematicModel:
    """Return the model of the arm, places in a unit of which so many are a metre."""
    limits = np.full(len(JOINTS), LIMITS)

    def function(angles: Array) -> tuple[Array, Array]:
        place, turn = pose(angles)
        return unit * place, turn

    return KinematicModel.from_function(function, JOINTS, -limits, limits)


@dataclass(frozen=True)
class ArmWorld:
    """What is perceived, and how.

    Attributes:
        fps: frames per second [1/s].
        unit: of places, how many are a metre.
        seen: what is perceived of the object beside its place: nothing, how its third axis points
            (a rotation vector without a turn about that axis), or its whole turn.
        noise: of places and of the object's turn, deviation [m], [rad].
    """

    fps: float = 40.0
    unit: float = 1.0
    seen: Seen = "turn"
    noise: float = 0.0

    @property
    def names(self) -> dict[str, tuple[str, ...]]:
        """Feature -> names of its dimensions."""
        turn = {"place": (), "axis": ("rx", "ry", "rz"), "turn": ("qw", "qx", "qy", "qz")}
        return {
            "observation.state": (*(f"{joint}.pos" for joint in JOINTS), "gripper"),
            "observation.environment_state": tuple(
                f"object.{name}" for name in ("x", "y", "z", *turn[self.seen])
            ),
            "action": (*JOINTS, "grip"),
        }


@dataclass
class ArmScene:
    """The arm and the object [m], [rad]."""

    world: ArmWorld
    handle: Array = field(default_factory=lambda: np.array(OBJECT))
    angle: float = 0.0  # of the object about the third axis at the beginning
    seed: int = 0
    gripper: float = OPEN
    held: tuple[Array, Rotation] | None = None  # the object in the hand's frame
    path: list[Array] = field(default_factory=list)  # of the handle

    def __post_init__(self) -> None:
        """Begin with the object at rest and the hand away from it."""
        self.turn = Rotation.from_rotvec([0, 0, self.angle])
        self.thing = np.array(self.handle) - self.turn.apply([HANDLE, 0, 0])
        self.stood = self.thing.copy()
        self.angles = posture(START)
        self.rng = np.random.default_rng(self.seed)

    @property
    def hand(self) -> Array:
        """Where the hand is."""
        return pose(self.angles)[0]

    @property
    def percept(self) -> NDArray[np.float32]:
        """What is perceived now."""
        world = self.world
        place = world.unit * (self.thing + self.rng.normal(0, world.noise, 3))
        turn = Rotation.from_rotvec(self.rng.normal(0, world.noise, 3)) * self.turn
        parts = [self.angles, [self.gripper], place, _seen(turn, world.seen)]
        return np.concatenate(parts).astype(np.float32)

    def move(self, action: NDArray[np.floating]) -> None:
        """Go on by a frame."""
        share = 1 - math.exp(-1 / (LAG * self.world.fps))
        self.angles = self.angles + share * (action[: len(JOINTS)] - self.angles)
        before, self.gripper = self.gripper, self.gripper + share * (action[-1] - self.gripper)
        place, matrix = pose(self.angles)
        hand = Rotation.from_matrix(matrix)
        at = self.thing + self.turn.apply([HANDLE, 0, 0])
        if before >= 0.5 > self.gripper and float(np.linalg.norm(at - place)) < GRASP:
            self.held = hand.inv().apply(self.thing - place), hand.inv() * self.turn
        elif self.gripper >= 0.5:
            self.held = None
        if self.held is not None:
            self.thing, self.turn = place + hand.apply(self.held[0]), hand * self.held[1]
        self.path.append(self.thing + self.turn.apply([HANDLE, 0, 0]))

    @property
    def missed(self) -> float:
        """How far from where it stood the object is [m]."""
        return float(np.linalg.norm(self.thing - self.stood))

    def passed(self, place: Sequence[float] = MOUTH) -> float:
        """Return how near the handle came to a place [m]."""
        return float(np.linalg.norm(np.array(self.path) - place, axis=1).min())


def _seen(turn: Rotation, seen: Seen) -> Array:
    """Return what is perceived of how the object is turned."""
    if seen == "turn":
        return np.roll(turn.as_quat(), 1)
    if seen == "place":
        return np.zeros(0)
    axis = turn.apply([0, 0, 1])
    across = np.cross([0, 0, 1], axis)
    sine = float(np.linalg.norm(across))
    return across * (math.atan2(sine, axis[2]) / sine if sine > 1e-12 else 1.0)


def script(now: ArmScene) -> tuple[Array, Array]:
    """Return commanded angles and the gripper's, `[T, 5]`: take it, to the mouth, back, withdraw.

    The hand comes along the handle's own axis.
    """
    handle = np.array(now.handle)
    away = now.turn.apply([-1, 0, 0]) if now.angle else handle * (-1, -1, 0)
    before = handle + BEFORE * away / np.linalg.norm(away) + np.array((0, 0, 0.05))
    over = handle + np.array((0, 0, 0.05))
    stops = [
        (START, 0, OPEN, 0), (before, 0, OPEN, 1.0), (handle, 0, OPEN, 0.6), (handle, 0, SHUT, 0.4),
        (MOUTH, TILT, SHUT, 1.2), (MOUTH, TILT, SHUT, 0.5), (over, 0, SHUT, 1.2),
        (handle, 0, SHUT, 0.4), (handle, 0, OPEN, 0.4), (before, 0, OPEN, 0.6),
        (START, 0, OPEN, 1.0),
    ]  # fmt: skip
    rows = []
    for (begin, pitch, _, _), (end, then, grip, time) in pairwise(stops):
        count = round(time * now.world.fps)
        for frame in range(count):
            share = (frame + 1) / count
            smooth = 10 * share**3 - 15 * share**4 + 6 * share**5
            at = np.array(begin) + smooth * (np.array(end) - begin)
            rows.append([*posture(at, pitch + smooth * (then - pitch)), grip])
    return np.array(rows), np.array(before)


def demonstrate(now: ArmScene, episode: int = 0) -> Demonstration:
    """Show the whole."""
    percepts, (actions, _) = [], script(now)
    for action in actions:
        percepts.append(now.percept)
        now.move(action)
    assert now.held is None
    assert now.missed < 0.01, "the script itself fails"
    assert now.passed() < 0.02
    rows, count = torch.from_numpy(np.stack(percepts)), len(JOINTS) + 1
    sent = torch.from_numpy(actions.astype(np.float32))
    return Demonstration(episode, "drink", rows[:, :count], rows[:, count:], sent)


def shown(world: ArmWorld, *episodes: Demonstration) -> Demonstrations:
    """Return these demonstrations; without any, one in the usual scene."""
    return Demonstrations(
        world.fps, world.names, episodes or (demonstrate(ArmScene(world)),), "an arm"
    )
