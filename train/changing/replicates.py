"""Replicates of a world that changes: each has data, learners and episodes of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from pacnet.forward_models.kinematics import KinematicModel
from train.changing import drink, gain
from train.common.replication import run_parts

GAIN, DRINK = "gain", "drink"
_WATCHING, _ALONE = "watching", "alone"  # parts of the drink
Scores = dict[str, dict[str, float]]  # experiment -> "stage or row | ... | score" -> value


def run_replicates(seeds: Sequence[int], episodes: int, body: KinematicModel) -> Iterator[Scores]:
    """Yield the scores of each replicate in the order of their seeds, run on all cores.

    Args:
        seeds: One for each replicate.
        episodes: To imitate for each way, row and stage.
        body: Model of the body of those who act alone.
    """
    parts = [
        {
            GAIN: partial(score_gain, seed),
            _WATCHING: partial(drink.watch_and_imitate, seed, episodes),
            _ALONE: partial(drink.act_alone, seed, episodes, body),
        }
        for seed in seeds
    ]
    for done in run_parts(parts):
        yield {GAIN: done[GAIN], DRINK: done[_WATCHING] | done[_ALONE]}


def score_gain(seed: int) -> dict[str, float]:
    """Return the scores of Experiment 2, with each error after two minutes over that of anew."""
    scores = gain.score(gain.make_world(seed))
    anew = scores[f"{gain.ANEW} | {gain.TWO_MINUTES} | error"]
    for row in gain.ROWS:
        scores[f"{row} | of anew"] = scores[f"{row} | {gain.TWO_MINUTES} | error"] / anew
    return scores
