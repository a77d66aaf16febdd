"""Demonstrations of how a turned mug is hung on a turned hook, by a script that knows the scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.turned_world import (
    ALIGNED,
    FPS,
    HANDLE,
    HOOK,
    SPEED,
    TURN_SPEED,
    Array,
    Variant,
    World,
    in_front,
)
from pacnet.datasets.demonstrations import Demonstration, Demonstrations

NOISE = 0.1  # standard deviation of the noise on an action within ±1
_GAIN = np.array([6.0, 6.0, 6.0, 4.0])  # speed for each unit of the way [1/s]
_LONGEST = 10 * FPS  # frames of a part
_GRIPPING = FPS // 2  # frames in which the gripper closes or opens


class _Part(NamedTuple):
    """A part of what is shown: where the hand goes, and until when."""

    mark: str
    distance: float
    """In front of the mark [m]."""
    gripper: float
    near: float = 0.0
    """Distance from there at which it is over [m]; 0 where it takes `_GRIPPING`."""


_PARTS = (
    _Part("mug", HANDLE + 0.08, -1, 0.03),
    _Part("mug", HANDLE, -1, 0.006),
    _Part("mug", HANDLE, 1),
    _Part("board", HOOK + 0.1, 1, 0.03),
    _Part("board", HOOK, 1, 0.006),
    _Part("board", HOOK, -1),
)  # the hand comes to handle and hook from outside


def demonstrations_of(variant: Variant, seed: int) -> Demonstrations:
    """Return one demonstration, the first that succeeds from a seed on."""
    random = np.random.default_rng(seed)
    while (found := _demonstrate(World(variant, random), random)) is None:
        pass
    percepts, actions = map(torch.from_numpy, found)
    names, own = variant.percept_names, len(variant.state_names)
    features = {
        "observation.state": variant.state_names,
        "observation.environment_state": names[own:],
        "action": variant.action_names,
    }
    one = Demonstration(0, "", percepts[:, :own], percepts[:, own:], actions)
    return Demonstrations(FPS, features, (one,))


def _demonstrate(
    world: World, random: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    """Return percepts `[T, D]` and the actions `[T, U]` that were executed; None if it fails."""
    percepts, actions = [], []
    for part in _PARTS:
        for frame in range(_LONGEST):
            way = _way(world, part)
            if _is_over(part, way, frame):
                break
            exact = _action(world.variant, way, part.gripper)
            action = np.clip(exact + random.normal(0, NOISE, len(exact)), -1, 1)
            percepts.append(world.percept())
            actions.append(action.astype(np.float32))
            world.step(action)
    return (np.array(percepts), np.array(actions)) if world.hangs else None


def _way(world: World, part: _Part) -> Array:
    """Return how far and how much the hand has to go and to turn, `[4]`."""
    pose = world.mug if part.mark == "mug" else world.board
    way = np.append(in_front(pose, part.distance), pose[3]) - world.hand
    return way if world.variant.hand_turns else way * [1, 1, 1, 0]


def _is_over(part: _Part, way: Array, frame: int) -> bool:
    if part.near == 0:
        return frame >= _GRIPPING
    return bool(np.linalg.norm(way[:3]) < part.near and abs(way[3]) < ALIGNED / 4)


def _action(variant: Variant, way: Array, gripper: float) -> Array:
    """Return the action that goes some way, without noise."""
    speeds = way * _GAIN / [SPEED, SPEED, SPEED, TURN_SPEED]
    yaw = [speeds[3]] if variant.hand_turns else []
    return np.clip([*speeds[: variant.dimensions], *yaw, gripper], -1, 1)
