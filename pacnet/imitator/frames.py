"""Chooses settings of frames of reference from demonstrations."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.attention.cutting import measure
from pacnet.datasets.demonstrations import Demonstrations, dimension_names
from pacnet.datasets.format import DatasetWarning
from pacnet.forward_models.affine import AffineForwardModel
from pacnet.forward_models.affine_fit import least_frames
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.forward_models.correction import find_position_targets
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.points import Points
from pacnet.schemas.scene import Scene, pose_dimensions, poses_of, scene_of
from pacnet.schemas.smoothing import choose_smoothing, smooth

Array = NDArray[np.float64]

MIN_EXPLAINED = 0.2  # share of the moved point's change that actions and momentum must predict
_TOLD = 0.3  # share that is left at most, of what its own movement leaves, of a moved point
_UNTOLD = 0.8  # and more than that of one that actions do not move
_LEAD = 0.0625  # [s] over which an action shows its effect
_SHARE = 0.1  # of its largest size, which is the least range of what is no point
_LEAST_RANGE = 2.0  # the same, in deviations of the percepts' scale
_MOVES = 0.05  # of the largest range of a pose's dimensions: of less it does not move


def choose_frames(
    points: Points, demonstrations: Demonstrations, scale: Sequence[float], given: bool
) -> FramesConfig | None:
    """Return settings for these points; None where actions do not move the first of them.

    Args:
        points: which dimensions of a percept are points.
        demonstrations: continuous ones.
        scale: factor on each dimension of a percept, `[D]`.
        given: whether the points were asked for; then it is an error that they can't be used.

    Raises:
        ValueError: points that are given and can't be used.
    """
    seen = [scene_of(one.percepts.numpy(), points) for one in demonstrations]
    smoothing = choose_smoothing([scene.places for scene in seen])
    scenes = [Scene(smooth(scene.places, smoothing), scene.turns) for scene in seen]
    poses = [poses_of(scene, points.moved) for scene in scenes]
    model = forward_model_for(points, poses, demonstrations)
    reason = _reason(points, scenes, poses, model, demonstrations)
    if reason is not None:
        return _refuse(reason, given)
    others, ranges = others_of(demonstrations, {*points.used}, scale)
    return FramesConfig(
        points,
        measure(moving([scene.places[:, 0] for scene in scenes]), demonstrations.fps),
        smoothing,
        others,
        ranges,
        model.config,
    )


def others_of(
    demonstrations: Demonstrations, used: set[int], scale: Sequence[float]
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return the dimensions of percepts that change and are not used, and their ranges.

    Args:
        demonstrations: some.
        used: dimensions of points, or of a body.
        scale: factor on each dimension of a percept, `[D]`.
    """
    percepts = torch.cat([one.percepts for one in demonstrations]).double()
    lowest, highest = percepts.amin(dim=0), percepts.amax(dim=0)
    changing = (highest > lowest).nonzero().ravel().tolist()  # what never changes says nothing
    others = tuple(sorted({*changing} - used))
    ranges = torch.maximum(highest - lowest, _SHARE * torch.maximum(highest, -lowest)).tolist()
    return others, tuple(max(ranges[number], _LEAST_RANGE / scale[number]) for number in others)


def _reason(
    points: Points,
    scenes: Sequence[Scene],
    poses: Sequence[Array],
    model: AffineForwardModel,
    demonstrations: Demonstrations,
) -> str | None:
    """Return why actions are not those that move the first point; None where they are."""
    try:
        fit_to_poses(model, poses, demonstrations)
    except ValueError as error:
        return str(error)
    share = model.explained_together(points.dimensions)
    another = _another(points, scenes, demonstrations, model.config.lead)
    if share >= MIN_EXPLAINED and another is None:
        return None
    predicted = f"with momentum, predict {share:.0%} of how it moves"
    got = f"move {another!r}" if another is not None else predicted
    return (
        f"expected actions that move {points.moved.name!r}, got some that {got}: name the point "
        "first that the robot's actions move"
    )


def _another(
    points: Points, scenes: Sequence[Scene], demonstrations: Demonstrations, lead: int
) -> str | None:
    """Return the point that actions move rather than the first, by name; None for none."""
    names, size = points.names, points.dimensions
    places = [[scene.places[:, number, :size] for scene in scenes] for number in range(len(names))]
    others = [number for number in range(1, len(names)) if moving(places[number])]
    left = {number: _left(places[number], demonstrations, lead) for number in (0, *others)}
    best = min(left, key=left.__getitem__)
    return names[best] if left[best] < _TOLD and left[0] > _UNTOLD else None


def _left(places: Sequence[Array], demonstrations: Demonstrations, lead: int) -> float:
    """Return the share that actions do not explain of what a point's own movement leaves."""
    size, count = places[0].shape[1], len(demonstrations.action_names)
    none = [replace(one, action=torch.zeros_like(one.action)) for one in demonstrations]
    errors = []
    for shown in (demonstrations, replace(demonstrations, episodes=tuple(none))):
        model = AffineForwardModel(AffineForwardModelConfig(size, count, lead, (-1,) * count))
        fit_to_poses(model, places, shown)
        errors.append(float(model.residual_variance.sum()))
    return errors[0] / errors[1] if errors[1] > 0 else 1.0


def moving(places: Sequence[Array]) -> list[Array]:
    """Return the places `[T, 3]` in those demonstrations in which the moved point moves."""
    return [place for place in places if np.ptp(place, axis=0).any()]


def _refuse(reason: str, given: bool) -> None:
    """Raise if points were asked for; else warn that those found by their names are not used."""
    if given:
        raise ValueError(reason)
    warnings.warn(f"points are not used: {reason}", DatasetWarning, stacklevel=2)


def forward_model_for(
    points: Points, poses: Sequence[Array], demonstrations: Demonstrations
) -> AffineForwardModel:
    """Return a forward model of the moved point's pose that has learned nothing."""
    names, fps = dimension_names(demonstrations.percept_features), demonstrations.fps
    moved = points.moved.place
    states = [torch.from_numpy(pose).float() for pose in poses]
    actions = [one.action for one in demonstrations]
    of_moved = [names[number] for number in moved]
    of_moved += [f"{points.moved.name} turn {i}" for i in range(states[0].shape[1] - len(moved))]
    follows, _ = find_position_targets(states, actions, of_moved, demonstrations.action_names, fps)
    lead = max(1, round(_LEAD * fps))
    config = AffineForwardModelConfig(
        len(pose_dimensions(points.moved)),
        len(demonstrations.action_names),
        lead,
        _whole(follows, np.concatenate(poses), len(moved)),
        turns=states[0].shape[1] - len(moved),
    )
    return AffineForwardModel(config)


def _whole(follows: tuple[int, ...], poses: Array, places: int) -> tuple[int, ...]:
    """Return what actions are places of, without what is so by chance.

    A robot is told where to go in all dimensions that move, each by one action, or in none.

    Args:
        follows: for each action the dimension of the pose, −1 for none.
        poses: of all frames, `[T, S]`.
        places: number of the pose's dimensions that are a place; the others are turns.
    """
    ranges, size = np.ptp(poses, axis=0), poses.shape[1]
    by_chance = set[int]()
    for part in (range(places), range(places, size)):
        told = [dimension for dimension in follows if dimension in part]
        move = {one for one in part if ranges[one] > _MOVES * max(ranges[list(part)])}
        if len(set(told)) < len(told) or not move <= {*told}:
            by_chance |= {*part}
    return tuple(-1 if one in by_chance else one for one in follows)


def fit_to_poses(
    model: AffineForwardModel, poses: Sequence[Array], demonstrations: Demonstrations
) -> None:
    """Fit the model to demonstrations that are long enough.

    Raises:
        ValueError: none is long enough.
    """
    least = least_frames(model.config.lead)
    rows = [
        (torch.from_numpy(pose).float(), one.action)
        for pose, one in zip(poses, demonstrations, strict=True)
        if len(pose) >= least
    ]
    if not rows:
        raise ValueError(
            f"expected a demonstration of more than {least - 1} frames to see what actions do"
        )
    model.fit([pose for pose, _ in rows], [action for _, action in rows])
