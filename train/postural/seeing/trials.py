"""Parts of a replicate: each row learns from some demonstrations, acts alone, and is scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from time import perf_counter

import numpy as np

from envs.postural_imitation import PosturalImitationEnv
from pacnet import Imitator
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from train.common.replication import run_parts
from train.postural.alone.actors import Actor, Alone
from train.postural.alone.episodes import Outcome, act
from train.postural.alone.scenes import Scene
from train.postural.episodes import Condition, make_environment, recall_seeds
from train.postural.seeing.actors import Nearest, Replay, Seeing
from train.postural.seeing.watching import RADIUS, record, told

OURS, STATE, TOLD = "ours", "state alone", "told where the glass is"
REPLAY, NEAREST = "replay of the nearest first picture", "1-NN over all frames"
ROWS = (OURS, STATE, TOLD, REPLAY, NEAREST)
COUNTS = (5, 20)  # demonstrations

OTHERS = 20  # episodes of a replicate, at most, of the rows beside ours and the state alone

STANDING = Scene((), radius=RADIUS)
ABSENT = replace(STANDING, own_glass="absent")


def run_replicates(
    folder: Path, seeds: range, episodes: int, body: KinematicModel
) -> Iterator[dict[str, dict[str, float]]]:
    """Yield the scores of each replicate, "row | demonstrations" -> score -> value.

    Args:
        folder: Of the run; datasets and imitators go there.
        seeds: Of the replicates.
        episodes: Number of places, in each of which ours and the state alone act; the other rows
            act in the first `OTHERS`.
        body: Model of the own body.
    """
    for seed in seeds:
        record(place_of(folder, seed) / "dataset", seed, max(COUNTS))
    yield from run_parts(
        [
            {
                cell(row, count): partial(
                    _score, place_of(folder, seed), row, count, seed, episodes, body
                )
                for row, count in product(ROWS, COUNTS)
            }
            for seed in seeds
        ]
    )


def cell(row: str, count: int) -> str:
    """Return the name of a row's part that learns from some demonstrations."""
    return f"{row} | {count}"


def place_of(folder: Path, seed: int) -> Path:
    """Return where a replicate's dataset and imitators are."""
    return folder / f"replicate-seed{seed}"


def imitator_of(place: Path, row: str, count: int) -> Path:
    """Return the checkpoint of a row that learned from some demonstrations."""
    return place / f"{row.replace(' ', '_')}_{count}"


def demonstrations_of(place: Path, count: int) -> Demonstrations:
    """Return the first demonstrations of a replicate, with their pictures."""
    shown = load_demonstrations(place / "dataset", cameras="all")
    return replace(shown, episodes=shown.episodes[:count])


def _score(
    place: Path, row: str, count: int, seed: int, episodes: int, body: KinematicModel
) -> dict[str, float]:
    """Return the scores of a row."""
    environment = make_environment(Condition())
    actor, seconds = _learned(place, row, count, seed, body, environment)
    seeds = recall_seeds(seed, episodes if row in (OURS, STATE) else min(episodes, OTHERS))
    done = [act(actor, environment, STANDING, one) for one in seeds]
    scores = {
        "success": _mean(done, lambda one: one.success),
        "false_alarms": _mean(done, lambda one: one.is_novel),
        "learning_s": seconds,
    }
    if row in (OURS, TOLD):
        absent = [act(actor, environment, ABSENT, one) for one in seeds]
        scores["absent_is_new"] = _mean(absent, lambda one: one.is_novel_in_time)
    environment.close()
    return scores


def _learned(
    place: Path,
    row: str,
    count: int,
    seed: int,
    body: KinematicModel,
    environment: PosturalImitationEnv,
) -> tuple[Actor, float]:
    """Return who acts in a row after so many demonstrations, and the seconds that it learned."""
    shown = told(seed, count) if row == TOLD else demonstrations_of(place, count)
    started = perf_counter()
    if row in (REPLAY, NEAREST):
        actor = (Replay if row == REPLAY else Nearest)(shown.episodes, environment)
        return actor, perf_counter() - started
    if row == STATE:
        imitator = Imitator.from_demonstrations(shown, points=None, encoder="none")
    else:
        imitator = Imitator.from_demonstrations(shown, body=body)
    imitator.learn(shown)
    seconds = perf_counter() - started
    imitator.save_pretrained(imitator_of(place, row, count))
    imitator.eval()
    return Alone(imitator) if row == TOLD else Seeing(imitator, environment), seconds


def _mean(done: list[Outcome], what: Callable[[Outcome], bool]) -> float:
    return float(np.mean([what(one) for one in done]))
