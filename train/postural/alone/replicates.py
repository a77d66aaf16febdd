"""Replicates: each has demonstrations, learners and episodes of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from train.common.summary import Summary, summarise
from train.postural.alone.learning import teach
from train.postural.alone.scenes import RADIUS
from train.postural.alone.scores import AloneScores, score_trials
from train.postural.alone.trials import Task, Trial, run_trials
from train.postural.episodes import recall_seeds
from train.postural.learning import learn, make_network, record


def run_replicate(
    folder: Path, body: KinematicModel, seed: int, episodes: int
) -> tuple[list[Trial], AloneScores]:
    """Teach imitators, let everybody act at every place, and score them.

    Args:
        folder: Of a run, which holds `dataset` and PACNet's `checkpoint`.
        body: Model of the imitators' body.
        seed: Of the replicate.
        episodes: Number of places near the usual one, and as many further away.
    """
    seconds = teach(folder, body)
    seeds = recall_seeds(seed, episodes)
    trials = run_trials(folder, [Task(radius, s) for radius in (0.0, RADIUS) for s in seeds])
    return trials, score_trials(trials, seconds)


def record_and_learn(
    folder: Path, seed: int, demonstrations: int, novelty_threshold: float
) -> None:
    """Record the demonstrations of a further replicate, and let PACNet learn them."""
    record(folder / "dataset", seed, demonstrations)
    network = make_network(novelty_threshold)
    learn(network, load_demonstrations(folder / "dataset"))
    network.save_pretrained(folder / "checkpoint")


def summary_of(replicates: Sequence[AloneScores]) -> dict[str, dict[str, Summary]]:
    """Return mean and standard deviation of each score over the replicates, group by group."""
    groups = AloneScores.__annotations__
    return {group: summarise([scores[group] for scores in replicates]) for group in groups}
