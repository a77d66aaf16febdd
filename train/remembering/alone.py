"""Acting alone on what is kept: an imitator whose memory holds only those frames."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pacnet import Imitator
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from train.postural.alone.actors import Alone
from train.postural.alone.episodes import act
from train.postural.alone.scenes import Scene
from train.postural.behaviours.episodes import TASKS
from train.postural.episodes import Condition, make_environment, recall_seeds
from train.remembering.rules import RULES, Choice
from train.remembering.streams import Stream, numbers_of, show

OURS, ALL = "keyframes (budget=)", "all frames"
ROWS = (OURS, *RULES, ALL)

_USUAL = Scene((), demonstrator="absent", radius=0.0)  # the glass stands where it was taught
_FEWEST = 2  # frames of a demonstration between which others are interpolated


def score_alone(
    stream: Stream, episodes: Mapping[int, int], seed: int, body: KinematicModel
) -> dict[str, float]:
    """Return "budget | row" -> share of episodes in which who acts alone does what is wanted.

    Args:
        stream: That was shown.
        episodes: Budget -> number of episodes.
        seed: Of the replicate.
        body: Model of the own body.
    """
    shown = show(stream, seed)
    environment = make_environment(Condition(behaviour=stream.wanted))
    whole = Imitator.from_demonstrations(shown, body=body)
    whole.learn(shown)

    def successes(imitator: Imitator, count: int) -> list[bool]:
        actor = Alone(imitator.eval(), TASKS[stream.wanted])
        seeds = recall_seeds(seed, count)
        return [act(actor, environment, _USUAL, s).success for s in seeds]

    def success(imitator: Imitator | None, count: int) -> float:
        return 0.0 if imitator is None else float(np.mean(successes(imitator, count)))

    everything, scores = successes(whole, max(episodes.values())), {}
    for budget, count in episodes.items():
        imitator = Imitator.from_demonstrations(shown, body=body, budget=budget)
        imitator.learn(shown)
        scores[f"{budget} | {OURS}"] = success(imitator, count)
        for row in RULES:
            scores[f"{budget} | {row}"] = success(
                _with_frames_of(row, whole, shown, budget, seed), count
            )
        scores[f"{budget} | {ALL}"] = float(np.mean(everything[:count]))
    environment.close()
    return scores


def _with_frames_of(
    row: str, whole: Imitator, shown: Demonstrations, budget: int, seed: int
) -> Imitator | None:
    """Return an imitator that keeps the frames that a rule chooses; None where none is usable.

    A demonstration of which a single frame is kept shows nothing, and goes.
    """
    percepts = np.concatenate([one.percepts.numpy() for one in shown])
    of, task = numbers_of(shown)
    scaled = percepts.astype(np.float64) * whole.config.scaling.array
    kept = np.zeros(len(of), bool)
    kept[RULES[row](Choice(scaled, of, task, budget, seed))] = True
    kept &= np.isin(of, np.flatnonzero(np.bincount(of[kept], minlength=len(shown)) >= _FEWEST))
    return _keep(whole, kept) if kept.any() else None


def _keep(whole: Imitator, kept: NDArray[np.bool_]) -> Imitator:
    imitator = whole.fork()
    assert imitator.frames is not None
    before = imitator.memory.whole()
    imitator.memory.select(kept)
    imitator.frames.cut_again(before, imitator.memory.whole())
    return imitator
