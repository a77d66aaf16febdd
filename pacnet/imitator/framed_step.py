"""One step of an imitator in frames of reference."""

from __future__ import annotations

from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from pacnet.competition.body_following import Body, limited
from pacnet.imitator.cuts import landmark_name
from pacnet.imitator.framed import FramedKnown
from pacnet.imitator.framed_novelty import score, unreached
from pacnet.imitator.novelty import NOVEL, NoveltyScore
from pacnet.imitator.records import Followed, ImitatorStep
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.scene import scene_at
from pacnet.schemas.segments import NO_SEGMENT


def framed_step(
    percept: NDArray[np.float32],
    known: FramedKnown,
    config: FramesConfig,
    names: tuple[str, ...],
    end_frames: float,
) -> ImitatorStep:
    """Return what to do at one percept `[D]`, in its own units, continuing from the last call.

    Args:
        percept: of finite numbers.
        known: what is known, and the recall episode.
        config: of the frames.
        names: of the percept's dimensions, and of what it implies.
        end_frames: frames before the last one of a demonstration from which it is done.
    """
    segments, state = known.segments, known.follower.state
    wanted, found = _follow(percept, known, config)
    state.pauses[0] = is_novel = not found.novelty <= NOVEL
    segment, row = state.segment.item(), state.row.item()
    target, followed, progress, done, landmark, number = None, (), 0.0, False, None, None
    if segment != NO_SEGMENT:
        demonstration = segments.demonstration[segment].item()
        if isinstance(known.model, Body) and config.body is not None:
            angles, before = percept[list(config.body.angles)], known.follower.command
            wanted = limited(wanted, known.model, before, angles)
            known.follower.command = None if is_novel else wanted[known.model.commands]
        target = wanted.astype(np.float32)
        followed = (Followed(demonstration, known.frame[row].item(), 1.0),)
        begin, end = segments.chain_around(segment)
        first, last = segments.first[begin].item(), segments.end[end - 1].item() - 1
        progress = (row - first) / max(1, last - first)
        done = bool(segments.after[end - 1] == NO_SEGMENT) and row >= last - end_frames
        landmark = landmark_name(config.points, segments.landmark[segment].item())
        number = segment - int(np.searchsorted(segments.demonstration, demonstration))
    return ImitatorStep(
        None if is_novel else target,
        is_novel,
        found.novelty,
        names[found.dimension],
        found.deviation,
        found.threshold,
        progress,
        done,
        followed,
        target,
        landmark,
        number,
    )


def _follow(
    percept: NDArray[np.float32], known: FramedKnown, config: FramesConfig
) -> tuple[NDArray[np.float64], NoveltyScore]:
    """Return the action at one percept, if a segment is followed then, and what is most novel."""
    from pacnet.competition.body_kernels import follow_with_body  # imports numba
    from pacnet.competition.framed_kernels import follow

    extension = known.follower.extension
    assert extension is not None
    places, turns = scene_at(extension(percept), config.points)
    others = percept[list(config.others)].astype(np.float64) / config.ranges
    segments, state, settings = known.segments, known.follower.state, known.follower.settings
    wanted, hold = np.empty(segments.action.shape[1]), known.follower.hold
    arguments = (places, turns, others, segments, known.allowed, state, settings, known.model)
    if hold is None:
        follow(*arguments, wanted)
        return wanted, score(places, others, known.bounds, config)
    follow_with_body(*arguments, hold, wanted)
    found = score(places, others, known.bounds, config)
    landmark = segments.landmark[state.segment.item()].item()
    missed = unreached(hold.miss, landmark, turns, config)
    return wanted, max(found, missed, key=attrgetter("novelty"))
