"""Following motor schemas in frames of reference.

Competition chooses, at the beginning and at every cut, the segment that begins in a scene most like
the present one. It is followed by position: the place in the sequence advances as far as the moved
point comes, waits for it and for what else is perceived, such as a gripper's opening, and goes on
where waiting brings it no nearer. What the moved point is off at the beginning fades along the way,
as in a movement primitive. A landmark is where it is now: one that is moved is followed. What is
held and lost leads back to where it was picked up.

The action is the one shown there, turned with the landmark, and a correction for what pose and
velocity are off, by the inverse of an affine forward model. In free movement that leads to the
places shown; in contact, where an action moves nothing, it pushes as was shown.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.competition.body_following import new_hold
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.percept_extension import PerceptExtension
from pacnet.schemas.scene import pose_dimensions
from pacnet.schemas.segments import NO_SEGMENT, Segments

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_LAG = 0.05  # [s] by which the moved point may be late
_PATIENCE = 0.125  # [s] without coming nearer after which the place in the sequence goes on


class FramedSettings(NamedTuple):
    """What following in frames depends on beside the motor schemas."""

    smoothing: Array
    """Alpha and beta of each point, `[P, 2]`."""
    extent: float
    """Size of the scene."""
    pose: Numbers
    """Which of a pose's six dimensions the forward model is of, `[I]`."""
    lag: int
    """`_LAG` in frames."""
    trust: float
    """Share of a deviation that is made good; less where places are noisy and smoothed, so late."""


class FramedState(NamedTuple):
    """A recall episode, and what is worked on in it."""

    seen: Numbers  # [1] percepts
    places: Array  # [P, 3], smoothed
    speeds: Array  # [P, 3] [1/frame]
    turns: Array  # [P, 4]
    turning: Array  # [3] [rad/frame], of the moved point
    segment: Numbers  # [1], or NO_SEGMENT
    row: Numbers  # [1]
    begun: Array  # [1], share of the segment's path that was over when following began
    offset: Array  # [3], of the moved point at the segment's beginning, in the landmark's axes
    offset_turn: Array  # [3] [rad]
    errors: Array  # [H], how far off it was in the last frames; above 1 it waits
    tries: Numbers  # [1], of these
    pauses: NDArray[np.bool_]  # [1], whether the last percept was novel, so that nothing was done
    candidate: NDArray[np.bool_]  # [S]
    layout: Array  # [F]
    spread: Array  # [F]
    error: Array  # [6], of the pose
    velocity: Array  # [6], by how much it differs
    moved: Array  # [6]
    relative: Array  # [U]


class FramedFollower:
    """A recall episode, percept by percept.

    Args:
        config: of the frames.
        actions: length U of an action.
        fps: frames per second [1/s].

    Attributes:
        settings: see `FramedSettings`.
        state: see `FramedState`.
        hold: see `Hold`; None without a body.
        extension: appends to percepts what they imply; None before anything was learned.
        command: the posture commanded last, of a body [rad]; None where there was none.
    """

    def __init__(self, config: FramesConfig, actions: int, fps: float) -> None:
        points = len(config.points.names)
        self.settings = FramedSettings(
            np.array(config.smoothing),
            config.size.extent,
            np.array(pose_dimensions(config.points.moved)),
            max(1, round(_LAG * fps)),
            config.smoothing[0][0],
        )
        features = 3 * points * (points - 1) // 2 + 6 * points + len(config.others)
        self.extension: PerceptExtension | None = None
        self.command: Array | None = None
        self.hold = None if config.body is None else new_hold(len(config.body.commands), points)
        self.state = FramedState(
            seen=np.zeros(1, np.int64),
            places=np.zeros((points, 3)),
            speeds=np.zeros((points, 3)),
            turns=np.zeros((points, 4)),
            turning=np.zeros(3),
            segment=np.full(1, NO_SEGMENT),
            row=np.zeros(1, np.int64),
            begun=np.zeros(1),
            offset=np.zeros(3),
            offset_turn=np.zeros(3),
            errors=np.zeros(max(1, round(_PATIENCE * fps))),
            tries=np.zeros(1, np.int64),
            pauses=np.zeros(1, bool),
            candidate=np.zeros(0, bool),
            layout=np.zeros(features),
            spread=np.zeros(features),
            error=np.zeros(6),
            velocity=np.zeros(6),
            moved=np.zeros(6),
            relative=np.zeros(actions),
        )

    def reset(self) -> None:
        """Begin a new episode."""
        self.state.seen[0] = 0
        self.state.segment[0] = NO_SEGMENT
        self.state.pauses[0] = False
        self.command = None
        if self.extension is not None:
            self.extension.reset()
        if self.hold is not None:
            self.hold.segment[0] = NO_SEGMENT
            self.hold.moved[0] = 0

    def make_room(self, segments: Segments) -> None:
        """Be ready for so many segments; an episode goes on."""
        if len(self.state.candidate) < len(segments.first):
            self.state = self.state._replace(candidate=np.zeros(len(segments.first), bool))
