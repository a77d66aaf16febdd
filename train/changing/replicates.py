"""Replicates of a world that changes: each has data, learners and episodes of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tqdm import tqdm

from pacnet.forward_models.kinematics import KinematicModel
from train.changing import drink, gain
from train.common.pool import processes

GAIN, DRINK = "gain", "drink"
Scores = dict[str, dict[str, float]]  # experiment -> "stage or row | ... | score" -> value


def run_replicates(seeds: Sequence[int], episodes: int, body: KinematicModel) -> Iterator[Scores]:
    """Yield the scores of each replicate in the order of their seeds, run on all cores.

    Args:
        seeds: One for each replicate.
        episodes: To imitate for each way, row and stage.
        body: Model of the body of those who act alone.
    """
    with processes() as pool, tqdm(total=3 * len(seeds), unit="part") as progress:
        parts = [
            (
                pool.submit(score_gain, seed),
                pool.submit(drink.watch_and_imitate, seed, episodes),
                pool.submit(drink.act_alone, seed, episodes, body),
            )
            for seed in seeds
        ]
        for part in (part for replicate in parts for part in replicate):
            part.add_done_callback(lambda _: progress.update())
        for changed, watching, alone in parts:
            yield {GAIN: changed.result(), DRINK: watching.result() | alone.result()}


def score_gain(seed: int) -> dict[str, float]:
    """Return the scores of Experiment 2, with each error after two minutes over that of anew."""
    scores = gain.score(gain.make_world(seed))
    anew = scores[f"{gain.ANEW} | {gain.TWO_MINUTES} | error"]
    for row in gain.ROWS:
        scores[f"{row} | of anew"] = scores[f"{row} | {gain.TWO_MINUTES} | error"] / anew
    return scores
