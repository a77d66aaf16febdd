"""Replicates: each has demonstrations, learners and episodes of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pacnet import PACNet
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from train.common.learning_log import LearningLog
from train.common.summary import Summary, summarise
from train.postural.alone.learning import teach
from train.postural.alone.scenes import RADIUS
from train.postural.alone.scores import AloneScores, score_trials
from train.postural.alone.trials import Task, Trial, run_trials
from train.postural.episodes import recall_seeds
from train.postural.learning import learn, record


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
    network = PACNet.from_pretrained(folder / "checkpoint").eval()
    return trials, score_trials(trials, network, seconds)


def record_and_learn(
    folder: Path, seed: int, count: int, network: PACNet, log: LearningLog | None = None
) -> Demonstrations:
    """Record a replicate's demonstrations, and let PACNet learn them.

    Args:
        folder: To which both go, as `dataset` and `checkpoint`.
        seed: Of the replicate.
        count: Number of demonstrations.
        network: Untrained; learns and is saved.
        log: Of its learning curves.
    """
    record(folder / "dataset", seed, count)
    demonstrations = load_demonstrations(folder / "dataset")
    learn(network, demonstrations, log)
    network.save_pretrained(folder / "checkpoint")
    return demonstrations


def summary_of(replicates: Sequence[AloneScores]) -> dict[str, dict[str, Summary]]:
    """Return mean and standard deviation of each score over the replicates, group by group."""
    groups = AloneScores.__annotations__
    return {group: summarise([scores[group] for scores in replicates]) for group in groups}
