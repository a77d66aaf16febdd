"""Replicates of the retraining experiment: partly spoiled demonstrations, and networks.

The networks of a replicate differ in their motor schemas and in the order of the demonstrations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from tqdm import tqdm

from envs.mishaps import MISHAPS
from pacnet import CompetingSchemasConfig, MotorSchemasConfig, PACNet
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder
from train.common.expected_findings import expect_findings
from train.common.pool import processes
from train.postural.episodes import (
    FPS,
    PERCEPTS,
    TARGETS,
    TASK,
    Condition,
    demonstration_seeds,
    make_environment,
    recall_episode,
    recall_seeds,
    watch_demonstration,
)
from train.postural.learning import (
    FEATURES,
    NOVELTY_THRESHOLD,
    frames_of,
    learn,
    make_network,
)
from train.postural.scores import Scores, score_episodes


class Policy(NamedTuple):
    """How a network learns.

    Attributes:
        schemas: Its motor schemas.
        shown: All demonstrations in the order in which they were drawn, all with the spoiled ones
            last, or only the unspoiled ones.
    """

    schemas: MotorSchemasConfig | CompetingSchemasConfig
    shown: Literal["as drawn", "spoiled last", "unspoiled"]


_OVERWRITTEN = MotorSchemasConfig(TARGETS, PERCEPTS)
_SEVERAL = CompetingSchemasConfig(TARGETS, PERCEPTS)

UNSPOILED = "unspoiled"
POLICIES = {
    "overwriting": Policy(_OVERWRITTEN, "as drawn"),
    "several_schemas": Policy(_SEVERAL, "as drawn"),
    "overwriting_spoiled_last": Policy(_OVERWRITTEN, "spoiled last"),
    "several_schemas_spoiled_last": Policy(_SEVERAL, "spoiled last"),
    UNSPOILED: Policy(_OVERWRITTEN, "unspoiled"),
}

WHY_SPOILED = "spoiled on purpose: the hand trembles, is interrupted or misses the glass"
_REPLICATES, _MISHAPS = 2, 3  # purposes for which seeds are drawn, after demonstrations and recalls


@dataclass(frozen=True)
class Replicate:
    """The seed of a replicate, and its mishaps.

    Attributes:
        seed: Of all its random numbers.
        mishaps: What goes wrong in each demonstration, in order; None for nothing.
    """

    seed: int
    mishaps: tuple[str | None, ...]


def draw_replicates(
    seed: int, count: int, demonstrations: int, spoiled: float
) -> tuple[Replicate, ...]:
    """Draw the replicates of a run; a smaller count gives the first of them.

    Args:
        seed: Of the run.
        count: Number of replicates.
        demonstrations: Number in each replicate, ≥ 2.
        spoiled: Share of them with a mishap, rounded; at least one, but not all.
    """
    number = min(max(round(spoiled * demonstrations), 1), demonstrations - 1)
    seeds = np.random.SeedSequence([seed, _REPLICATES]).generate_state(count).tolist()
    return tuple(Replicate(own, _draw_mishaps(own, demonstrations, number)) for own in seeds)


def _draw_mishaps(seed: int, demonstrations: int, number: int) -> tuple[str | None, ...]:
    rng = np.random.default_rng([seed, _MISHAPS])
    mishaps: list[str | None] = [None] * demonstrations
    for place in rng.choice(demonstrations, number, replace=False).tolist():
        mishaps[place] = str(rng.choice(MISHAPS))
    return tuple(mishaps)


@dataclass(frozen=True)
class TrainingRun:
    """One network of one replicate.

    Attributes:
        replicate: Whose demonstrations it learns.
        policy: One of `POLICIES`.
        dataset: Folder of the demonstrations.
        checkpoint: Folder to save it in.
        episodes: Number of new episodes to recall.
    """

    replicate: Replicate
    policy: str
    dataset: Path
    checkpoint: Path
    episodes: int


def record(replicate: Replicate, folder: Path) -> None:
    """Record a replicate's demonstrations, including spoiled ones, into a LeRobot dataset."""
    environment = make_environment(Condition())
    seeds = demonstration_seeds(replicate.seed, len(replicate.mishaps))
    with Recorder(folder, FPS, FEATURES, "postural_imitation") as recorder:
        for seed, mishap in zip(seeds, replicate.mishaps, strict=True):
            percepts = watch_demonstration(environment, seed, mishap)
            recorder.save_episode(TASK, frames_of(percepts))
    spoiled = [place for place, mishap in enumerate(replicate.mishaps) if mishap is not None]
    expect_findings(folder, "episodes.*", WHY_SPOILED, spoiled)


def shown_to(policy: Policy, replicate: Replicate) -> list[int]:
    """Return the indices of the demonstrations that a network learns, in order."""
    spoiled = [mishap is not None for mishap in replicate.mishaps]
    if policy.shown == "as drawn":
        return list(range(len(spoiled)))
    first = [place for place, bad in enumerate(spoiled) if not bad]
    if policy.shown == "unspoiled":
        return first
    return first + [place for place, bad in enumerate(spoiled) if bad]


def teach(run: TrainingRun) -> None:
    """Let a network learn its demonstrations, each once, and save it."""
    policy = POLICIES[run.policy]
    recorded = load_demonstrations(run.dataset)
    shown = tuple(
        replace(recorded.episodes[place], episode=number)
        for number, place in enumerate(shown_to(policy, run.replicate))
    )
    network = PACNet(replace(make_network(NOVELTY_THRESHOLD).config, schemas=policy.schemas))
    learn(network, replace(recorded, episodes=shown))
    network.save_pretrained(run.checkpoint)


def teach_and_score(run: TrainingRun) -> Scores:
    """Teach a network, load it, and score it on episodes without mishaps."""
    teach(run)
    network = PACNet.from_pretrained(run.checkpoint).eval()
    environment = make_environment(Condition())
    seeds = recall_seeds(run.replicate.seed, run.episodes)
    scores = score_episodes([recall_episode(network, environment, seed) for seed in seeds])
    schemas = int((network.schemas.lengths > 0).sum())
    return {"nodes": len(network.sofm), "schemas": schemas, **scores}


def run_replicates(
    replicates: Sequence[Replicate], folder: Path, episodes: int
) -> Iterator[dict[str, Scores]]:
    """Yield policy -> scores of each replicate in turn, run on all cores.

    Args:
        replicates: To run.
        folder: Of the run, for datasets and checkpoints.
        episodes: Number to recall with each network.
    """
    datasets = [folder / "dataset" / f"replicate-{number}" for number in range(len(replicates))]
    runs = [
        TrainingRun(
            replicate, policy, dataset, folder / "checkpoint" / dataset.name / policy, episodes
        )
        for replicate, dataset in zip(replicates, datasets, strict=True)
        for policy in POLICIES
    ]
    steps = len(replicates) + len(runs)
    with processes() as pool, tqdm(total=steps, desc="retraining", unit="step") as progress:
        for _ in pool.map(record, replicates, datasets):
            progress.update()
        done: dict[str, Scores] = {}
        for run, scores in zip(runs, pool.map(teach_and_score, runs), strict=True):
            progress.update()
            done[run.policy] = scores
            if len(done) == len(POLICIES):
                yield done
                done = {}
