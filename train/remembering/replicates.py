"""Replicates of what is worth remembering: each has demonstrations and episodes of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from pacnet.forward_models.kinematics import KinematicModel
from train.common.replication import run_parts
from train.remembering import walls
from train.remembering.alone import score_alone
from train.remembering.cues import score_cues
from train.remembering.streams import NOISY, PLAIN, RARE, RESTS, STREAMS

ALONE, CUES, WALLS = "alone", "cues", "walls"
EXPERIMENTS = (ALONE, CUES, WALLS)
BUDGET = 40  # targets of a drink, at which all are compared
BUDGETS = (10, 20, BUDGET, 80, 200, 500)
CURVE = (20, BUDGET, 100)  # of those who act alone

Scores = dict[str, dict[str, float]]  # experiment -> "stream | budget | row" -> value


def budgets_alone(stream: str, episodes: int) -> dict[int, int]:
    """Return budget -> number of episodes in which somebody acts alone.

    All of them are played after rests, at `BUDGET`; elsewhere a tenth.
    """
    few = -(-episodes // 10)
    if stream not in (PLAIN, RESTS):
        return {BUDGET: few}
    return dict.fromkeys(CURVE, few) | ({BUDGET: episodes} if stream == RESTS else {})


def run_replicates(
    seeds: Sequence[int],
    episodes: int,
    body: KinematicModel,
    experiments: Sequence[str] = EXPERIMENTS,
) -> Iterator[Scores]:
    """Yield the scores of each replicate in the order of their seeds, run on all cores.

    Args:
        seeds: One for each replicate.
        episodes: At the budget and after the rests at which all are compared.
        body: Model of the body of those who act alone.
        experiments: Some of EXPERIMENTS.
    """
    parts = [
        {name: job for name, job in _jobs(seed, episodes, body) if name[0] in experiments}
        for seed in seeds
    ]
    for done in run_parts(parts):
        scores: Scores = {name: {} for name in experiments}
        for (experiment, stream), values in done.items():
            scores[experiment] |= {f"{stream} | {name}": v for name, v in values.items()}
        yield scores


def _jobs(
    seed: int, episodes: int, body: KinematicModel
) -> Iterator[tuple[tuple[str, str], Callable[[], dict[str, float]]]]:
    """Yield what a replicate consists of: experiment and stream, and what scores it."""
    for name in (RESTS, PLAIN, RARE, NOISY):
        budgets = budgets_alone(name, episodes)
        yield (ALONE, name), partial(score_alone, STREAMS[name], budgets, seed, body)
    for name, stream in STREAMS.items():
        many = BUDGETS if name in (PLAIN, RESTS) else (BUDGET,)
        yield (CUES, name), partial(score_cues, stream, many, seed)
    yield (WALLS, walls.RESTS), partial(walls.score, seed)
