"""Turns demonstrations that were cut into motor schemas, each in the frame of its landmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.attention.cutting import across_gaps, carried
from pacnet.forward_models.affine_rows import placed
from pacnet.forward_models.kinematic_arrays import KinematicArrays
from pacnet.schemas.chains import (
    ANY_LEG,
    GOES_ON,
    Chains,
    after_gaps,
    in_chains,
    successors,
    usual_chains,
)
from pacnet.schemas.demonstration_memory import Shown
from pacnet.schemas.frame_choice import choose_landmarks
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.holding import held_in
from pacnet.schemas.scene import (
    Scene,
    conjugate,
    landmark_of,
    multiply,
    pose_dimensions,
    poses_of,
    rotate,
)
from pacnet.schemas.segments import CONTINUES, NO_SEGMENT, Segments
from pacnet.schemas.smoothing import moving_average, smoothed_scene

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_ACTION_TIME = 0.04  # [s] over which shown actions are averaged


class Framed(NamedTuple):
    """One demonstration of T frames, as far as that does not depend on landmarks."""

    scene: Scene
    velocity: Array
    """Change of the moved point's pose from the last frame, `[T, 6]`."""
    action: Array
    """Smoothed; relative to the present place where an action is a place, `[T, U]`."""
    others: Array
    """In shares of their ranges, `[T, Q]`."""
    carried: NDArray[np.bool_]
    """Whether each landmark moves, `[T, M]`."""
    hand: Array
    """With a body, where the hand is with the angles that are commanded: place, turn, `[T, 7]`."""


def framed(
    percepts: NDArray[np.floating],
    actions: NDArray[np.floating],
    config: FramesConfig,
    fps: float,
    kinematics: KinematicArrays | None,
) -> Framed:
    """Return a demonstration's scene and movement.

    Args:
        percepts: `[T, D]`, extended, in their own units.
        actions: `[T, U]`.
        config: of frames.
        fps: frames per second [1/s].
        kinematics: of the body; None without one.
    """
    scene = smoothed_scene(percepts, config.points, config.smoothing)
    poses = poses_of(scene, config.points.moved)
    velocity = np.zeros((len(poses), 6))
    velocity[1:, pose_dimensions(config.points.moved)] = np.diff(poses, axis=0)
    model = config.forward_model
    relative = actions if model is None else actions - placed(poses, model.follows)
    averaged = moving_average(relative, round(_ACTION_TIME * fps))
    hand = np.zeros((len(poses), 7))
    if config.body is not None and kinematics is not None:
        from pacnet.forward_models.kinematic_kernels import poses_at  # imports numba

        hand = poses_at(kinematics, averaged[:, config.body.commands])
    return Framed(
        scene,
        velocity,
        averaged,
        percepts[:, config.others].astype(np.float64) / config.ranges,
        carried(scene.places, config.size, fps),
        hand,
    )


def segments_of(
    demonstrations: Sequence[Framed],
    cuts: Mapping[str, Numbers],
    shown: Shown,
    config: FramesConfig,
    fps: float,
) -> Segments:
    """Return all segments; arguments in the order of the demonstrations.

    Args:
        demonstrations: E of them.
        cuts: see `SegmentMemory.columns`.
        shown: the same demonstrations.
        config: of frames.
        fps: frames per second [1/s].
    """
    from pacnet.schemas.layout_kernels import layouts  # imports numba

    extent = config.size.extent
    places, turns, velocity, action, others, carried, hand = (
        np.concatenate(parts)
        for parts in zip(*[(*one.scene, *one[1:]) for one in demonstrations], strict=True)
    )
    scene, number = Scene(places, turns), cuts["demonstration"]
    later = np.unique(number[cuts["begins"] == CONTINUES])
    carried = across_gaps(carried, shown.first[later].tolist(), fps)
    end = cuts["frames"].cumsum()
    first = end - cuts["frames"]
    rests = ~np.logical_or.reduceat(carried, first)
    rests[:, len(config.perceived) :] = False  # when something is put back is told by itself
    cuts = {**cuts, "landmark": after_gaps(cuts, rests)}
    chains = in_chains(cuts, cuts["landmark"], shown)
    usual, landmark = _usual(scene, carried, cuts, chains, extent)
    after = successors(chains, landmark, usual)
    frames = cuts["frames"]
    held = held_in(scene, carried, first, end, config)
    origin, axes = landmark_of(scene, landmark.repeat(frames))
    back = conjugate(axes)
    rows, moved = np.arange(len(places)), held.moved.repeat(frames)
    turned = turns[rows, held.turned.repeat(frames)]
    place = rotate(back, places[rows, moved] - origin)
    seen = [rotate(back, velocity[:, :3]), rotate(back, velocity[:, 3:])]
    grip, grip_turn = held.place.repeat(frames, axis=0), held.turn.repeat(frames, axis=0)
    goal = rotate(back, hand[:, :3] + rotate(hand[:, 3:], grip) - origin)
    goal_turn = multiply(multiply(back, hand[:, 3:]), grip_turn)
    return Segments(
        first, end, landmark, number, chains.order, chains.leg, after, usual,
        layouts(places[first], turns[first], others[first], extent),
        places, turns, place, multiply(back, turned),
        np.concatenate(seen, axis=1), axes, _shares(place, first, end), action, others, carried,
        held.moved, held.turned, held.about_axis, goal, goal_turn,
    )  # fmt: skip


def _usual(
    scene: Scene,
    carried: NDArray[np.bool_],
    cuts: Mapping[str, Numbers],
    chains: Chains,
    extent: float,
) -> tuple[NDArray[np.bool_], Numbers]:
    """Return whether segments are of usual chains, and in whose frames they are kept, `[S]` each.

    How near the moved point comes to a landmark says whether it was attained only where the frame
    is that landmark's. So what is usual is told first by the landmarks alone.
    """
    attended, frames = cuts["landmark"], cuts["frames"]
    goal, first = attended.repeat(frames) + 1, frames.cumsum() - frames
    apart = np.linalg.norm(scene.places[np.arange(len(goal)), goal] - scene.places[:, 0], axis=1)
    nearest = np.minimum.reduceat(apart, first)  # 0 without a landmark
    usual, landmark = np.ones(len(attended), bool), attended
    for distance in (np.zeros(len(attended)), nearest):
        known = np.where(landmark == attended, distance, 0.0)
        usual = usual_chains(chains, attended, known, extent)[chains.chain]
        landmark = choose_landmarks(scene, carried, cuts, _kinds(chains, usual), extent)
        for one in np.flatnonzero(chains.leg == GOES_ON)[::-1]:  # one leg has one landmark
            landmark[one - 1] = landmark[one]
    return usual, landmark


def _kinds(chains: Chains, usual: NDArray[np.bool_]) -> Numbers:
    """Return which segments end what is shown alike, by number, `NO_SEGMENT` for others, `[S]`."""
    goes_on = chains.leg == GOES_ON
    leg = np.maximum.accumulate(np.where(goes_on, 0, np.arange(len(goes_on))))  # where it begins
    leg = chains.leg[leg]
    ends = ~np.append(goes_on[1:], False) & (leg != ANY_LEG) & usual
    return np.where(ends, chains.task[chains.chain] * (leg.max() + 1) + leg, NO_SEGMENT)


def _shares(place: Array, first: NDArray[np.int64], end: NDArray[np.int64]) -> Array:
    """Return the share of its segment's path that is over at each row, `[R]`."""
    steps = np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1)
    way = steps.cumsum()
    frames = end - first
    begin, whole = way[first].repeat(frames), (way[end - 1] - way[first]).repeat(frames)
    return (way - begin) / np.maximum(whole, 1e-300)
