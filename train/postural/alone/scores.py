"""Scores of those who act alone, from trials to the tables of `metrics.json`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from pacnet import PACNet
from train.postural.alone.mirror import mirror
from train.postural.alone.scenes import ALONE, OURS, SCENES, STRANGE, USUAL
from train.postural.alone.trials import Trial

Cells = dict[str, float]  # "scene | row" -> mean over episodes


class AloneScores(TypedDict):
    """Scores of one replicate; `docs/experiments.md` defines each."""

    success: Cells
    distance_m: Cells
    novelty: dict[str, float]
    mirror: dict[str, float]
    timing: dict[str, float]


def score_trials(trials: Sequence[Trial], network: PACNet, learning_seconds: float) -> AloneScores:
    """Return the scores of one replicate: means over its trials.

    Args:
        trials: At the places of every radius.
        network: Whose map watched the demonstrations.
        learning_seconds: That the imitator of all demonstrations took to learn.
    """
    success, distance = Cells(), Cells()
    for name, scene in SCENES.items():
        here = [trial for trial in trials if name in trial.outcomes]
        for row in scene.rows:
            cell = f"{name} | {row}"
            success[cell] = _mean([trial.outcomes[name][row].success for trial in here])
            distance[cell] = _mean([trial.distances[name][row] for trial in here])
        distance[f"{name} | another demonstrator"] = _mean([trial.floor for trial in here])
    return {
        "success": success,
        "distance_m": distance,
        "novelty": _score_novelty(trials),
        "mirror": mirror(network, trials).shares,
        "timing": {
            "learning_s": learning_seconds,
            "step_s": float(np.median([done.step_seconds for done in ours(trials, ALONE)])),
        },
    }


def ours(trials: Sequence[Trial], scene: str) -> list:
    """Return what the imitator of all demonstrations did in each trial of a scene."""
    return [trial.outcomes[scene][OURS] for trial in trials if scene in trial.outcomes]


def _score_novelty(trials: Sequence[Trial]) -> dict[str, float]:
    """Return how often something strange was called new in time, and something known at all."""
    in_time = {name: _mean([d.is_novel_in_time for d in ours(trials, name)]) for name in STRANGE}
    alarms = {name: _mean([d.is_novel for d in ours(trials, name)]) for name in (USUAL, ALONE)}
    return in_time | alarms


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
