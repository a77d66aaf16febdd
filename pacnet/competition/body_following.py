"""A recall episode of a robot whose body says where its hand is: postures, and what it holds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.forward_models.kinematic_arrays import KinematicArrays, ReachWork
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.segments import NO_SEGMENT, Segments

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

# In shares of the scene's size for each rad: what a place may be off for the sake of a turn, and
# for the sake of the posture shown.
_HAND_TURN, _HELD_TURN, _POSTURE = 0.02, 0.06, 0.02
_FASTER = 2.0  # times as fast as a joint was shown to move, it may move
_STEPS = 4  # of damped least squares, from the posture found last


class Body(NamedTuple):
    """What following with a body depends on."""

    kinematics: KinematicArrays
    commands: Numbers
    """Dimensions of the action that are targets of the angles, `[J]`."""
    moves: NDArray[np.bool_]
    """Whether each angle moves the hand, `[J]`."""
    free: tuple[float, float, int]
    """Weights of `reach` for the hand itself."""
    carrying: tuple[float, float, int]
    """Weights of `reach` for what it carries."""
    fastest: float
    """Change of a commanded angle in a frame, at most [rad]."""
    work: ReachWork


class Hold(NamedTuple):
    """The postures of a recall episode, and how the hand holds what it carries."""

    segment: Numbers  # [1], of the last step
    posture: Array  # [J] [rad], the one commanded last
    shown: Array  # [J] [rad], the one to stay near to
    ahead: Array  # [J] [rad], at the end of the segment
    off: Array  # [4], by how much the posture is off: along three axes, and turned [rad]
    miss: Array  # [4], by how much the one at the end of the way to a landmark would be
    moved: Numbers  # [1], what is carried, 0 for nothing
    frames: Numbers  # [1], since it was taken
    place: Array  # [3], of what is carried in the hand, the mean
    turns: Array  # [1, 4], the sum of its quaternions relative to the hand
    places: Array  # [P, 3], of all points, before the hand was at them
    axes: Array  # [P, 4], how they were turned


def body_of(config: FramesConfig, kinematics: KinematicArrays, segments: Segments) -> Body:
    """Return what following depends on.

    Args:
        config: of frames, with a body.
        kinematics: what its model has learned.
        segments: of all demonstrations.
    """
    from pacnet.forward_models.kinematic_kernels import make_work  # imports numba

    assert config.body is not None
    commands, extent = np.array(config.body.commands, np.int64), config.size.extent
    moves = np.zeros(len(commands), bool)
    moves[kinematics.moving] = True
    return Body(
        kinematics,
        commands,
        moves,
        (_HAND_TURN * extent, _POSTURE * extent, _STEPS),
        (_HELD_TURN * extent, _POSTURE * extent, _STEPS),
        _FASTER * _fastest(segments, commands),
        make_work(kinematics),
    )


def _fastest(segments: Segments, commands: Numbers) -> float:
    """Return the largest change of a commanded angle from frame to frame that was shown [rad]."""
    changes = np.abs(np.diff(segments.action[:, commands], axis=0))
    begins = np.flatnonzero(np.diff(segments.demonstration)) + 1
    changes[segments.first[begins] - 1] = 0.0  # from the end of a demonstration to the next
    return float(changes.max(initial=0.0))


def limited(wanted: Array, body: Body, before: Array | None, angles: NDArray[np.floating]) -> Array:
    """Return the action `[U]`, not more than `body.fastest` from the posture commanded before.

    Args:
        wanted: action, which changes.
        body: see `Body`.
        before: the last command `[J]` [rad]; None where nothing was commanded.
        angles: that are perceived, `[J]` [rad]: where the robot is then.
    """
    at = angles.astype(np.float64) if before is None else before
    change = (wanted[body.commands] - at).clip(-body.fastest, body.fastest)
    wanted[body.commands] = at + change
    return wanted


def new_hold(joints: int, points: int) -> Hold:
    """Return the state of an episode that has not begun, for J joints and P points."""
    return Hold(
        segment=np.full(1, NO_SEGMENT),
        posture=np.zeros(joints),
        shown=np.zeros(joints),
        ahead=np.zeros(joints),
        off=np.zeros(4),
        miss=np.zeros(4),
        moved=np.zeros(1, np.int64),
        frames=np.zeros(1, np.int64),
        place=np.zeros(3),
        turns=np.zeros((1, 4)),
        places=np.zeros((points, 3)),
        axes=np.zeros((points, 4)),
    )
