"""An arm of joint angles that lifts a cup and puts it back, for tests of imitators with a body."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.forward_models.kinematics import KinematicModel

Array = NDArray[np.float64]

JOINTS = ("turn", "shoulder", "neck", "elbow")  # the neck moves no hand
STATE, SURROUNDINGS, ACTION = "observation.state", "observation.environment_state", "action"
NAMES = {
    STATE: tuple(f"{joint}.pos" for joint in JOINTS),
    SURROUNDINGS: ("cup.x", "cup.y", "cup.z", "cup.rx", "cup.ry", "cup.rz"),
    ACTION: JOINTS,
}
CUP = f"cup={SURROUNDINGS}[0:3]+{SURROUNDINGS}[3:6]"
FPS = 25
LINK, BASE = 0.3, 0.2  # [m] of both links, and of the shoulder over the table
REST, LIFTED = np.array([0.0, 0.9, 0.1, -2.2]), np.array([0.6, 0.7, -0.1, -0.6])  # [rad]
LEG, PAUSE = 30, 6  # [frames] of a movement, and of the rest after it
PLACE = (0.35, 0.1, 0.02)  # [m] of the cup in demonstrations, unless given


def hand_of(angles: Array) -> tuple[Array, Array]:
    """Where the hand is [m], and its rotation matrix, in a posture `[4]` [rad]."""
    turn, shoulder, _, elbow = angles
    bent = shoulder + elbow
    out = LINK * (math.cos(shoulder) + math.cos(bent))
    up = BASE + LINK * (math.sin(shoulder) + math.sin(bent))
    c, s, b, d = math.cos(turn), math.sin(turn), math.cos(bent), math.sin(bent)
    about_z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    about_y = np.array([[b, 0, -d], [0, 1, 0], [d, 0, b]])
    return np.array([c * out, s * out, up]), about_z @ about_y


def posture_at(place: Array) -> Array:
    """The posture that takes the hand to a place, by the law of cosines."""
    x, y, z = place
    out, up = math.hypot(x, y), z - BASE
    elbow = -math.acos((out**2 + up**2 - 2 * LINK**2) / (2 * LINK**2))
    inner = math.atan2(LINK * math.sin(elbow), LINK + LINK * math.cos(elbow))
    return np.array([math.atan2(y, x), math.atan2(up, out) - inner, 0.0, elbow])


@cache
def arm() -> KinematicModel:
    """A model of this body; not to be changed."""
    return KinematicModel.from_function(hand_of, JOINTS, [-1.5, -0.5, -1, -2.8], [1.5, 2, 1, 0])


def arm_in(folder: Path) -> Path:
    """A checkpoint of it."""
    arm().save_pretrained(folder)
    return folder


def carried(angles: Array, held: Array) -> Array:
    """Where a cup is that was taken upright in a posture, and its rotation vector, `[6]`.

    Args:
        angles: of the posture now, `[4]`.
        held: of the one in which it was taken, `[4]`.
    """
    place, matrix = hand_of(angles)
    turned = matrix @ hand_of(held)[1].T
    axis = np.array(
        [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
    )
    sine, cosine = np.linalg.norm(axis) / 2, (np.trace(turned) - 1) / 2
    return np.append(place, axis * math.atan2(sine, cosine) / max(1e-12, 2 * sine))


def lift(number: int = 0, place: tuple[float, ...] = PLACE, seed: int = 0) -> Demonstration:
    """Take the cup, lift it, put it back, and leave."""
    rng, at = np.random.default_rng((seed, number)), posture_at(np.array(place))
    stations = [REST, at, LIFTED, at, REST]
    angles, around = [], []
    for leg, (begin, end) in enumerate(pairwise(stations)):
        share = np.append(np.linspace(0, 1, LEG), np.ones(PAUSE))[:, None]
        path = begin + (end - begin) * (3 * share**2 - 2 * share**3)
        angles += [*path]
        around += [carried(one if leg in (1, 2) else at, at) for one in path]
    state = np.array(angles)
    seen = state + 1e-3 * rng.standard_normal(state.shape)
    cup = np.array(around) + 1e-3 * rng.standard_normal((len(around), 6))
    ahead = np.append(state[1:], state[-1:], axis=0)
    rows = (torch.from_numpy(one).float() for one in (seen, cup, ahead))
    return Demonstration(number, "lift the cup", *rows)


def lifts(*places: tuple[float, ...], seed: int = 0) -> Demonstrations:
    """A demonstration for each place of the cup."""
    shown = (lift(number, place, seed) for number, place in enumerate(places))
    return Demonstrations(FPS, NAMES, tuple(shown), "lifts")


def record_lifts(root: Path, *places: tuple[float, ...], seed: int = 0) -> Path:
    """The same as a dataset."""
    with Recorder(root, FPS, NAMES, "arm") as recorder:
        for one in lifts(*places, seed=seed):
            values = (one.state, one.environment_state, one.action)
            named = zip(NAMES, (value.numpy() for value in values), strict=True)
            recorder.save_episode(one.task, dict(named))
    return root
