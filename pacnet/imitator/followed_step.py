"""One step of an imitator without frames of reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pacnet.competition.following import State
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.forward_model import Model
from pacnet.imitator.novelty import NOVEL
from pacnet.imitator.records import Followed, ImitatorStep
from pacnet.imitator.state import Known


def followed_step(
    percept: NDArray[np.float32],
    scaled: NDArray[np.float32],
    known: Known,
    config: ImitatorConfig,
    model: Model | None,
    end_frames: float,
) -> ImitatorStep:
    """Return what to do at one percept, continuing from the last call.

    Args:
        percept: `[D]`, of finite numbers.
        scaled: the same, scaled.
        known: what is known, and the recall episode.
        config: of the imitator.
        model: finds the action that leads to a target; None where targets are actions.
        end_frames: frames before the last one of a demonstration from which it is done.
    """
    from pacnet.competition.following_kernels import follow  # imports numba

    shown, state = known.shown, known.state
    wanted = np.empty(config.target_dimensions)
    follow(scaled, shown, known.allowed, state, known.settings, known.correction, wanted)
    nearest, heaviest = state.nearest.item(), state.heaviest.item()
    score = known.detector.score(scaled, None if nearest < 0 else shown.percepts[nearest])
    is_novel = not score.novelty <= NOVEL  # NaN, which cannot be compared, counts as novel
    target = None if heaviest < 0 else wanted.astype(np.float32)
    action = None if target is None else _action(percept, target, config, model)
    unit = known.correction.unit[score.dimension].item()
    return ImitatorStep(
        None if is_novel else action,
        is_novel,
        score.novelty,
        config.percept_names[score.dimension],
        score.deviation * unit,
        score.threshold * unit,
        state.progress.item(),
        heaviest >= 0 and _is_at_end(known, state, heaviest, end_frames),
        _followed(known, state),
        target,
    )


def _action(
    percept: NDArray[np.float32],
    target: NDArray[np.float32],
    config: ImitatorConfig,
    model: Model | None,
) -> NDArray[np.float32] | None:
    if model is None:
        return target
    size = config.state_dimensions
    action = model.command_one(percept[:size], target[:size])
    if action is not None:
        action[list(config.still_actions)] = target[size:]
    return action


def _is_at_end(known: Known, state: State, slot: int, end_frames: float) -> bool:
    """Return whether a followed demonstration is in its last frames that are kept."""
    number, shown = state.demonstration[slot], known.shown
    last = shown.time[shown.first[number + 1] - 1]
    return bool(shown.time[state.row[slot]] >= last - end_frames)


def _followed(known: Known, state: State) -> tuple[Followed, ...]:
    """Return the demonstrations that decide, the largest weight first."""
    slots = state.weight.nonzero()[0]
    frames = known.shown.frame[state.row[slots]].tolist()
    numbers, weights = state.demonstration[slots].tolist(), state.weight[slots].tolist()
    followed = map(Followed, numbers, frames, weights)
    return tuple(sorted(followed, key=lambda one: -one.weight))
