"""One step of an imitator in frames of reference."""

from __future__ import annotations

from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from pacnet.imitator.cuts import landmark_name
from pacnet.imitator.framed import FramedKnown
from pacnet.imitator.framed_novelty import score, unreached
from pacnet.imitator.novelty import NOVEL
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
    from pacnet.competition.body_kernels import follow_with_body  # imports numba
    from pacnet.competition.framed_kernels import follow

    extension = known.follower.extension
    assert extension is not None
    places, turns = scene_at(extension(percept), config.points)
    others = percept[list(config.others)].astype(np.float64) / config.ranges
    segments, state = known.segments, known.follower.state
    wanted, settings = np.empty(segments.action.shape[1]), known.follower.settings
    seen, hold = (places, turns, others), known.follower.hold
    if hold is not None:
        follow_with_body(
            *seen, segments, known.allowed, state, settings, known.model, hold, wanted
        )  # fmt: skip
    else:
        follow(*seen, segments, known.allowed, state, settings, known.model, wanted)
    found = score(places, others, known.bounds, config)
    if hold is not None:
        landmark = segments.landmark[state.segment.item()].item()
        missed = unreached(hold.miss, landmark, turns, config)
        found = max(found, missed, key=attrgetter("novelty"))
    state.pauses[0] = is_novel = not found.novelty <= NOVEL
    segment, row = state.segment.item(), state.row.item()
    target, followed, progress, done, landmark, number = None, (), 0.0, False, None, None
    if segment != NO_SEGMENT:
        demonstration = segments.demonstration[segment].item()
        target = wanted.astype(np.float32)
        followed = (Followed(demonstration, row - known.first[demonstration].item(), 1.0),)
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
