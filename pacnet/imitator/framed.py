"""What an imitator keeps in frames of reference: cuts, a forward model, and what follows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.cutting import carried, cut
from pacnet.competition.body_following import Body, body_of
from pacnet.competition.framed_following import FramedFollower
from pacnet.core.integrity import check_on_load, check_structure, part_of
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.affine import AffineForwardModel
from pacnet.forward_models.affine_arrays import AffineArrays
from pacnet.forward_models.affine_fit import least_frames
from pacnet.forward_models.kinematic_arrays import KinematicArrays
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.cuts import Approach
from pacnet.imitator.framed_model import for_frames
from pacnet.imitator.framed_novelty import Bounds, bounds_of, novelty_of
from pacnet.imitator.frames import fit_to_poses
from pacnet.schemas.demonstration_memory import Shown
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.framing import Framed, framed, segments_of
from pacnet.schemas.percept_extension import PerceptExtension
from pacnet.schemas.scene import Scene, poses_of, scene_of
from pacnet.schemas.segments import CONTINUES, MIDDLE, SegmentMemory, Segments
from pacnet.schemas.smoothing import smoothed_scene


class FramedKnown(NamedTuple):
    """What `Imitator.step` works on in frames of reference."""

    segments: Segments
    model: AffineArrays | Body
    bounds: Bounds
    allowed: NDArray[np.bool_]
    """Which segments are of the task that was asked for, `[S]`."""
    follower: FramedFollower
    frame: NDArray[np.int64]
    """Number of each row in its demonstration as it was shown, `[R]`."""


class FramedSchemas(nn.Module):
    """The part of an imitator that keeps targets in the frames of landmarks.

    Args:
        config: see `FramesConfig`.
        fps: frames per second [1/s].
    """

    def __init__(self, config: FramesConfig, fps: float) -> None:
        super().__init__()
        self.config, self.fps = config, fps
        self.segments = SegmentMemory(len(config.points.landmarks))
        model, body = config.forward_model, config.body
        self.forward_model = None if model is None else AffineForwardModel(model)
        self.body = None if body is None else KinematicModel(body.model)
        self._framed: list[Framed] = []  # derived from the demonstrations, as the next two
        self._derived: tuple[Shown, Segments, Bounds] | None = None
        self._past = self.extension()  # of the episode of the last demonstration
        check_on_load(self)

    def take_body(self, body: KinematicModel) -> None:
        """Take over what a model of the body has learned."""
        assert self.body is not None
        self.body.load_state_dict(body.state_dict())
        self.forget_derived()

    def has_body(self, body: KinematicModel) -> bool:
        """Return whether its body is this one, or an equal one."""
        if self.body is None or self.body.config != body.config:
            return False
        pairs = zip(self.body.buffers(), body.buffers(), strict=True)
        return all(torch.equal(own, other.to(own)) for own, other in pairs)

    def fit(self, demonstrations: Demonstrations) -> None:
        """Fit the forward model to continuous demonstrations, unless it was fitted before.

        Where all are too short nothing is fitted.
        """
        model = self.forward_model
        longest = max((len(one.state) for one in demonstrations), default=0)
        if model is None or model.moves.any() or longest < least_frames(model.config.lead):
            return
        scenes = [self._smoothed(one.percepts.numpy()) for one in demonstrations]
        poses = [poses_of(scene, self.config.points.moved) for scene in scenes]
        fit_to_poses(model, poses, demonstrations)

    def cut(
        self,
        number: int,
        percepts: NDArray[np.float32],
        begins: int,
        shown: Shown,
        unit: NDArray[np.float64],
    ) -> None:
        """Keep where a demonstration is cut.

        Args:
            number: its own.
            percepts: `[T, D]`, in their own units.
            begins: how; see `SegmentMemory.append`.
            shown: the demonstrations up to it, whole.
            unit: of each scaled dimension, `[D]`.
        """
        extension, begins = self.extension(), _with_its_head(begins, number, shown)
        if begins == CONTINUES:
            how = self.segments.begins(number)
            first = max(one for one in range(number) if how[one] != CONTINUES)
            extension.episode(shown.percepts[shown.first[first] : shown.first[number]] * unit)
        landmark = self._approach(extension.episode(percepts, goes_on=True)).landmark
        self.segments.append(number, landmark, begins)

    def cut_again(self, before: Shown, shown: Shown) -> None:
        """Cut demonstrations of which fewer frames are kept now where they were cut before.

        Args:
            before: all demonstrations, whole, as they are cut.
            shown: the same with what is kept now, whole.
        """
        cuts, begins = self.segments.columns(), self.segments.begins(len(shown.frames)).tolist()
        landmark = cuts["landmark"].repeat(cuts["frames"])
        self.segments.clear()
        self.forget_derived()
        for number in np.flatnonzero(shown.frames).tolist():
            old, new = (slice(*one.first[number : number + 2]) for one in (before, shown))
            at = np.searchsorted(before.frame[old], shown.frame[new], side="right") - 1
            begin = _with_its_head(begins[number], number, shown)
            self.segments.append(number, landmark[old][at], begin)

    def episodes(self) -> NDArray[np.int64]:
        """Return the number of the episode that each demonstration is a part of, `[E]`."""
        numbers = self.segments.columns()["demonstration"]
        count = int(numbers.max()) + 1 if len(numbers) else 0
        return (self.segments.begins(count) != CONTINUES).cumsum()

    def extension(self) -> PerceptExtension:
        """Return what appends to the percepts of an episode what they imply."""
        return PerceptExtension(self.config, self._kinematics())

    def _kinematics(self) -> KinematicArrays | None:
        return None if self.body is None else self.body.arrays()

    def novelty(self, percepts: NDArray[np.float32], bounds: Bounds) -> NDArray[np.float64]:
        """Return the novelty of an episode's percepts `[T, D]`, beside what was shown, `[T]`.

        What a body cannot reach is seen only while acting.
        """
        config = self.config
        scene = scene_of(self.extension().episode(percepts), config.points)
        others = percepts[:, config.others].astype(np.float64) / config.ranges
        return novelty_of(scene, others, bounds)

    def approach(self, shown: Demonstration) -> Approach:
        """Return how an episode of T ≥ 1 frames, learned or not, comes near the landmarks."""
        extension = self.extension()
        parts = [
            self._approach(extension.episode(part.percepts.numpy(), goes_on=True))
            for part in shown.continuous()
        ]
        return Approach(*map(np.concatenate, zip(*parts, strict=True)))

    def _approach(self, extended: NDArray[np.floating]) -> Approach:
        places, config = self._smoothed(extended).places, self.config
        distances = np.linalg.norm(places[:, 1:] - places[:, :1], axis=2)
        landmark = cut(places, config.size, self.fps, config.put_back)
        return Approach(distances, landmark, carried(places, config.size, self.fps))

    def _smoothed(self, extended: NDArray[np.floating]) -> Scene:
        return smoothed_scene(extended, self.config.points, self.config.smoothing)

    def known(
        self,
        shown: Shown,
        unit: NDArray[np.float64],
        allowed: NDArray[np.bool_],
        follower: FramedFollower,
    ) -> FramedKnown | None:
        """Return what a recall episode works on; None before anything was learned.

        Args:
            shown: the demonstrations, whole.
            unit: of each scaled dimension, `[D]`.
            allowed: which demonstrations may be followed, bool `[E]`.
            follower: of the episode.

        Raises:
            ValueError: cuts that are not of these demonstrations.
        """
        tensors = self.state_dict()
        self.check_state(tensors)
        self.check_cuts(tensors, shown.frames)
        if not shown.frames.any():
            return None
        segments, bounds = self._derive(shown, unit)
        follower.make_room(segments)
        follower.extension = follower.extension or self.extension()
        return FramedKnown(
            segments,
            self._model(segments),
            bounds,
            allowed[segments.demonstration],
            follower,
            shown.frame,
        )

    def _model(self, segments: Segments) -> AffineArrays | Body:
        """Return what finds actions."""
        config, kinematics = self.config, self._kinematics()
        if config.body is not None and kinematics is not None:
            return body_of(config, kinematics, segments)
        assert self.forward_model is not None
        return for_frames(self.forward_model.arrays(), segments, config)

    def _derive(self, shown: Shown, unit: NDArray[np.float64]) -> tuple[Segments, Bounds]:
        """Return the segments of these demonstrations, and the bounds of what was shown."""
        if self._derived is None or self._derived[0] is not shown:
            kinematics, how = self._kinematics(), self.segments.begins(len(shown.frames))
            for number in np.flatnonzero(shown.frames)[len(self._framed) :]:
                rows = slice(shown.first[number], shown.first[number + 1])
                goes_on = how[number] == CONTINUES
                percepts = self._past.episode(shown.percepts[rows] * unit, goes_on=goes_on)
                actions = shown.targets[rows]
                self._framed.append(framed(percepts, actions, self.config, self.fps, kinematics))
            cuts = self.segments.columns()
            segments = segments_of(self._framed, cuts, shown, self.config, self.fps)
            self._derived = shown, segments, bounds_of(segments)
        return self._derived[1:]

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)  # all but the models
        for name, model in (("forward_model.", self.forward_model), ("body.", self.body)):
            if model is not None:
                model.check_state(part_of(tensors, name))

    def check_cuts(self, tensors: Mapping[str, Tensor], frames: NDArray[np.int64]) -> None:
        """Raise a ValueError unless demonstrations are cut whole.

        Args:
            tensors: a state that was checked.
            frames: of each demonstration, `[E]`.
        """
        columns = part_of(tensors, "segments.rows.")
        self.segments.check_cuts(frames, {name: one.numpy() for name, one in columns.items()})

    def forget_derived(self) -> None:
        """Derive all anew from the demonstrations, which have changed."""
        self._framed, self._derived, self._past = [], None, self.extension()


def _with_its_head(begins: int, number: int, shown: Shown) -> int:
    """Return how a demonstration begins: what goes on where nothing is kept, in the middle."""
    return MIDDLE if begins == CONTINUES and shown.frames[number - 1] == 0 else begins
