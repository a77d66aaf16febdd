"""Turns demonstrations that were cut into motor schemas, each in the frame of its landmark."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.attention.cutting import carried
from pacnet.forward_models.affine_rows import placed
from pacnet.schemas.demonstration_memory import Shown
from pacnet.schemas.frame_choice import choose_landmarks
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.scene import (
    Scene,
    conjugate,
    landmark_of,
    multiply,
    pose_dimensions,
    poses_of,
    rotate,
    scene_of,
)
from pacnet.schemas.segments import NO_SEGMENT, Segments
from pacnet.schemas.smoothing import smooth

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_ACTION_TIME = 0.04  # [s] over which shown actions are averaged
_ENOUGH = 3  # demonstrations of a task from which the usual landmarks can be told


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


def framed(
    percepts: NDArray[np.floating], actions: NDArray[np.floating], config: FramesConfig, fps: float
) -> Framed:
    """Return a demonstration's scene and movement.

    Args:
        percepts: `[T, D]`, in their own units.
        actions: `[T, U]`.
        config: of frames.
        fps: frames per second [1/s].
    """
    seen = scene_of(percepts, config.points)
    scene = Scene(smooth(seen.places, config.smoothing), seen.turns)
    poses = poses_of(scene, config.points.moved)
    velocity = np.zeros((len(poses), 6))
    velocity[1:, pose_dimensions(config.points.moved)] = np.diff(poses, axis=0)
    relative = actions - placed(poses, config.forward_model.follows)
    return Framed(
        scene,
        velocity,
        _averaged(relative, round(_ACTION_TIME * fps)),
        percepts[:, config.others].astype(np.float64) / config.ranges,
        carried(scene.places, config.size, fps),
    )


def _averaged(rows: Array, frames: int) -> Array:
    """Return rows `[T, U]`, each the mean of so many around it, an odd number."""
    half = max(0, frames // 2)
    padded = np.pad(rows, ((half, half), (0, 0)), mode="edge")
    sums = np.concatenate([np.zeros((1, rows.shape[1])), padded.cumsum(axis=0)])
    return (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)


def segments_of(
    demonstrations: Sequence[Framed],
    cuts: Mapping[str, Numbers],
    shown: Shown,
    extent: float,
) -> Segments:
    """Return all segments; arguments in the order of the demonstrations.

    Args:
        demonstrations: E of them.
        cuts: demonstration, frames and landmark of each segment, `[S]`; see `SegmentMemory`.
        shown: the same demonstrations.
        extent: size of the scene.
    """
    from pacnet.schemas.layout_kernels import layouts  # imports numba

    places, turns, velocity, action, others, carried = (
        np.concatenate(parts)
        for parts in zip(*[(*one.scene, *one[1:]) for one in demonstrations], strict=True)
    )
    scene, number = Scene(places, turns), cuts["demonstration"]
    end = cuts["frames"].cumsum()
    first = end - cuts["frames"]
    order, after = _in_order(number)
    usual = _usual(cuts["landmark"], number, shown)
    kinds = np.where(usual, shown.task[number] * (order.max() + 1) + order, NO_SEGMENT)
    landmark = choose_landmarks(scene, carried, cuts, kinds, extent)
    origin, axes = landmark_of(scene, landmark.repeat(cuts["frames"]))
    back = conjugate(axes)
    place = rotate(back, places[:, 0] - origin)
    seen = [rotate(back, velocity[:, :3]), rotate(back, velocity[:, 3:])]
    return Segments(
        first, end, landmark, number, order, after, usual,
        layouts(places[first], turns[first], others[first], extent),
        places, turns, place, multiply(back, turns[:, 0]), np.concatenate(seen, axis=1), axes,
        _shares(place, first, end), action, others, carried,
    )  # fmt: skip


def _in_order(number: Numbers) -> tuple[Numbers, Numbers]:
    """Return the number of each segment in its demonstration, and the one after it, `[S]`."""
    index, begins = np.arange(len(number)), np.diff(number, prepend=-1) != 0
    order = index - np.maximum.accumulate(np.where(begins, index, 0))
    after = np.where(np.append(begins[1:], True), NO_SEGMENT, index + 1)
    return order, after


def _shares(place: Array, first: NDArray[np.int64], end: NDArray[np.int64]) -> Array:
    """Return the share of its segment's path that is over at each row, `[R]`."""
    steps = np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1)
    way = steps.cumsum()
    frames = end - first
    begin, whole = way[first].repeat(frames), (way[end - 1] - way[first]).repeat(frames)
    return (way - begin) / np.maximum(whole, 1e-300)


def _usual(landmark: Numbers, number: Numbers, shown: Shown) -> NDArray[np.bool_]:
    """Return whether segments are of demonstrations that go where most of their task go, `[S]`.

    A demonstration that goes back, since something failed, is left to the others. A correction is
    usual where it is needed.
    """
    cuts = np.flatnonzero(np.diff(number)) + 1
    ways = [tuple(part.tolist()) for part in np.split(landmark, cuts)]
    usual = np.ones(len(ways), bool)
    for one in set(shown.task.tolist()):
        alike = np.flatnonzero((shown.task == one) & ~shown.correction)
        if len(alike) >= _ENOUGH:
            most, count = Counter(ways[index] for index in alike).most_common(1)[0]
            usual[alike] = [2 * count <= len(alike) or ways[index] == most for index in alike]
    return usual[number]
