"""A small world for tests of frames of reference: a hand picks up an object, takes it to a goal.

The hand lags behind its commands. It holds the object from when it closes near its handle until it
opens. All of it is in metres and seconds, but percepts may be in another unit and of turned axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator
from pacnet.schemas.points import Point, Points

Array = NDArray[np.float64]

FPS = 20
LAG = 0.3  # share of a commanded change of speed, or of the gripper, that comes about in a frame
REACH = 0.05  # [m] from the handle within which a gripper that closes takes hold
HANDLE = 0.12  # [m] from the object's middle along its first axis, where it has a handle
ALIGNED = 0.3  # [rad] between hand and object within which it takes hold, where both turn
FASTEST = 0.6  # [m/s]
SHUT, OPEN = 0.0, 1.0
START = (0.0, -0.4, 0.3)  # of the hand, as many of them as there are dimensions
OBJECT, GOAL = (0.3, 0.1, 0.0), (-0.3, 0.3, 0.1)  # in demonstrations, unless given
HEIGHT = 0.1  # [m] that the script goes over the handle, along the last axis
HAND_ANGLE = -0.6  # of a hand that turns, at the beginning [rad]
DONE = 0.06  # [m] from the goal within which an object must lie


@dataclass(frozen=True)
class World:
    """What is perceived and commanded.

    Attributes:
        dimensions: of places, 2 or 3.
        command: what an action says of the hand.
        unit: of the percepts' places and of commanded ones, how many are a metre.
        axes: angle about the last axis by which the percepts' places are turned [rad].
        object_turns: whether the object has an orientation, and a handle at one side.
        hand_turns: whether the hand has one, which is commanded as a speed [rad/s].
    """

    dimensions: int = 2
    command: Literal["velocity", "displacement", "place"] = "velocity"
    unit: float = 1.0
    axes: float = 0.0
    object_turns: bool = False
    hand_turns: bool = False

    @property
    def names(self) -> dict[str, tuple[str, ...]]:
        """Feature -> names of its dimensions."""
        axes = "xyz"[: self.dimensions]
        turns = ("angle",) if self.dimensions == 2 else ("qw", "qx", "qy", "qz")
        hand = [f"hand.{axis}" for axis in axes]
        state = [*hand, *[f"hand.{turn}" for turn in turns if self.hand_turns], "gripper"]
        around = [f"{name}.{axis}" for name in ("object", "goal") for axis in axes]
        at = self.dimensions
        around[at:at] = [f"object.{turn}" for turn in turns if self.object_turns]
        action = [*[f"move {axis}" for axis in axes], *["turn"] * self.hand_turns, "grip"]
        return {
            "observation.state": tuple(state),
            "observation.environment_state": tuple(around),
            "action": tuple(action),
        }

    @property
    def points(self) -> Points:
        """The hand, the object and the goal."""
        sizes = (self.hand_turns, None, self.object_turns, False)  # None is the gripper
        at, ranges = 0, []
        for turns in sizes:
            place = 1 if turns is None else self.dimensions
            more = (1 if self.dimensions == 2 else 4) if turns else 0
            ranges.append(
                (tuple(range(at, at + place)), tuple(range(at + place, at + place + more)))
            )
            at += place + more
        hand, _, thing, goal = ranges
        landmarks = (Point("object", *thing), Point("goal", *goal))
        return Points(Point("hand", *hand), landmarks)


@dataclass
class Scene:
    """Where everything is [m], [rad]; places of all dimensions of the world."""

    world: World
    thing: Array
    goal: Array
    angle: float = 0.0
    hand: Array = field(default_factory=lambda: np.zeros(0))
    speed: Array = field(init=False)
    hand_angle: float = field(init=False)
    gripper: float = OPEN
    held: tuple[Array, float] | None = None  # the object's place and angle in the hand's axes

    def __post_init__(self) -> None:
        """Begin where the hand does, at rest."""
        size = self.world.dimensions
        self.thing, self.goal = self.thing[:size].copy(), self.goal[:size].copy()
        if len(self.hand) == 0:
            self.hand = np.array(START[:size])
        self.speed = np.zeros(size)
        self.hand_angle = HAND_ANGLE * self.world.hand_turns

    @property
    def handle(self) -> Array:
        """Where the object is to be held."""
        if not self.world.object_turns:
            return self.thing
        return self.thing + turned(self.angle, HANDLE * np.eye(self.world.dimensions)[0])

    @property
    def percept(self) -> NDArray[np.float32]:
        """What is perceived now."""
        world = self.world
        place = lambda at: world.unit * turned(world.axes, at)  # noqa: E731
        turn = lambda angle: _turn(world, angle + world.axes)  # noqa: E731
        parts = [
            place(self.hand),
            turn(self.hand_angle) if world.hand_turns else [],
            [self.gripper],
            place(self.thing),
            turn(self.angle) if world.object_turns else [],
            place(self.goal),
        ]
        return np.concatenate(parts).astype(np.float32)

    def move(self, action: NDArray[np.floating]) -> None:
        """Go on by a frame."""
        world, size = self.world, self.world.dimensions
        wanted = np.float64(action[:size])
        if world.command == "displacement":
            wanted = wanted * FPS
        elif world.command == "place":
            wanted = clipped(5 * (turned(-world.axes, wanted / world.unit) - self.hand), FASTEST)
        self.speed += LAG * (wanted - self.speed)
        self.hand = self.hand + self.speed / FPS
        if world.hand_turns:
            self.hand_angle += float(action[size]) / FPS
        before, self.gripper = self.gripper, self.gripper + LAG * (action[-1] - self.gripper)
        if self.held is None and before >= 0.5 > self.gripper and self._is_at_handle():
            place = turned(-self.hand_angle, self.thing - self.hand)
            self.held = place, self.angle - self.hand_angle
        elif self.gripper > 0.5:
            self.held = None
        if self.held is not None:
            self.thing = self.hand + turned(self.hand_angle, self.held[0])
            self.angle = self.hand_angle + self.held[1]

    def _is_at_handle(self) -> bool:
        apart = math.remainder(self.hand_angle - self.angle, math.tau)
        aligned = not self.world.hand_turns or abs(apart) < ALIGNED
        return aligned and float(np.linalg.norm(self.handle - self.hand)) < REACH

    @property
    def is_done(self) -> bool:
        """Whether the object lies at the goal, with its handle if it has one."""
        return self.held is None and float(np.linalg.norm(self.handle - self.goal)) < DONE

    def command(self, place: Array, angle: float, gripper: float) -> NDArray[np.float32]:
        """Return the action that leads to a place and an angle."""
        world = self.world
        speed = clipped(3 * (place - self.hand), FASTEST / 2)
        if world.command == "displacement":
            speed = speed / FPS
        elif world.command == "place":
            at = self.hand + clipped(place - self.hand, 0.12)
            speed = world.unit * turned(world.axes, at)
        spin = np.clip(3 * (angle - self.hand_angle), -1.5, 1.5)
        return np.float32([*speed, *[spin] * world.hand_turns, gripper])


def turned(angle: float, place: Array) -> Array:
    """Return a place `[2]` or `[3]` turned about the last axis."""
    cosine, sine = math.cos(angle), math.sin(angle)
    x, y = place[:2]
    return np.array([cosine * x - sine * y, sine * x + cosine * y, *place[2:]])


def clipped(vector: Array, most: float) -> Array:
    return vector * min(1.0, most / max(1e-12, float(np.linalg.norm(vector))))


def _turn(world: World, angle: float) -> list[float]:
    if world.dimensions == 2:
        return [math.remainder(angle, math.tau)]
    return [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]


def scene(
    world: World,
    thing: tuple[float, ...] = OBJECT,
    goal: tuple[float, ...] = GOAL,
    angle: float = 0.0,
) -> Scene:
    return Scene(world, np.array(thing), np.array(goal), angle)


def somewhere(world: World, seed: int) -> Scene:
    """A scene with the object and the goal anywhere, but not at one place."""
    random = np.random.default_rng(seed)
    while True:
        thing, goal = random.uniform(-0.5, 0.5, (2, 3)) * (1, 1, 0.3)
        start = np.array(START[: world.dimensions])
        three = (thing[: world.dimensions], goal[: world.dimensions], start)
        apart = [np.linalg.norm(a - b) for a in three for b in three if a is not b]
        if min(apart) > 0.3:
            return Scene(world, thing, goal)


def demonstrate(
    now: Scene, episode: int = 0, task: str = "pick", carry: bool = True
) -> Demonstration:
    """Show the whole, by a script: over the handle, down to it, shut, up, to the goal, open.

    Without `carry` it goes to the goal only.
    """
    percepts, actions = [], []
    over = HEIGHT * np.eye(now.world.dimensions)[-1]

    def go(place: Callable[[], Array], gripper: float, near: float = 0.02, least: int = 0) -> None:
        for frame in range(80):
            if frame >= least and np.linalg.norm(place() - now.hand) < near:
                break
            action = now.command(place(), now.angle, gripper)
            percepts.append(now.percept)
            actions.append(action)
            now.move(action)

    if carry:
        go(lambda: now.handle + over, OPEN)
        go(lambda: now.handle, OPEN, 0.01, 4)
        go(lambda: now.handle, SHUT, 0.02, 8)
        lifted = now.hand + over
        go(lambda: lifted, SHUT)
        go(lambda: now.goal + now.hand - now.handle, SHUT, 0.01)
        go(lambda: now.hand, OPEN, 0.02, 8)
        assert now.is_done, "the script itself fails"
    else:
        go(lambda: now.goal, OPEN, 0.01)
    rows, size = torch.from_numpy(np.stack(percepts)), len(now.world.names["observation.state"])
    sent = torch.from_numpy(np.stack(actions))
    return Demonstration(episode, task, rows[:, :size], rows[:, size:], sent)


def shown(world: World, *episodes: Demonstration) -> Demonstrations:
    return Demonstrations(FPS, world.names, episodes, "picking")


def one_demonstration(world: World) -> Demonstrations:
    return shown(world, demonstrate(scene(world)))


def taught(world: World, *episodes: Demonstration) -> Imitator:
    """An imitator that has learned these demonstrations; without any, one in the usual scene."""
    demonstrations = shown(world, *episodes) if episodes else one_demonstration(world)
    imitator = Imitator.from_demonstrations(demonstrations, points=world.points)
    imitator.learn(demonstrations)
    return imitator


def act(
    imitator: Imitator,
    now: Scene,
    frames: int = 250,
    meanwhile: Callable[[int, Scene], None] | None = None,
) -> bool:
    """Let the imitator act; return whether the object is at the goal in the end.

    Args:
        imitator: that acts, from a new episode on.
        now: the scene, which changes.
        frames: at most.
        meanwhile: what happens before each frame.
    """
    imitator.reset()
    for frame in range(frames):
        if meanwhile is not None:
            meanwhile(frame, now)
        step = imitator.step(now.percept)
        if step.action is None:
            return False
        now.move(step.action)
    return now.is_done
