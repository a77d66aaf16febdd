"""Ablations of Experiment 2: recall, compared with variants that each lack one part.

Each replicate has its own wandering, forward model, demonstrations and map, drawn from its seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from tqdm import tqdm

from envs.wall_behaviours import Side
from pacnet import ForwardModel, PACNet
from train.common.pool import processes
from train.common.runs import UNSEEN_ARENAS
from train.walls.drivers import Driver, Recalling, Teacher, Wandering
from train.walls.episodes import TAUGHT_SIDES, Place, act_alone, alone_seed
from train.walls.learning import NEAREST_CUES, frames, make_network, teach
from train.walls.nearest import NearestTargets
from train.walls.scores import SIDES, cluster_agreement, name_clusters, score_run, side_kept
from train.walls.variants import (
    Learned,
    constant_target,
    fitted_model,
    learn,
    mean_action,
    shuffled_targets,
    speed_free,
    transition_matrix,
    untrained,
    with_forward_model,
)

STEPS = 2500  # of a run
UNSEEN = 3  # arenas

Scores = dict[str, float]


def run_conditions(learned: Learned, steps: int = STEPS) -> dict[str, Scores]:
    """Return the scores of every condition, averaged over its runs."""
    conditions = _conditions(learned)
    scores = {}
    with tqdm(total=len(conditions), desc="conditions", unit="condition") as progress:
        for name, runs in conditions.items():
            progress.set_postfix_str(name)
            scores[name] = _mean([run(learned, steps) for run in runs])
            progress.update()
    return scores


def replicate(seed: int, arena: str | int, steps: int = STEPS) -> dict[str, Scores]:
    """Return the scores of a replicate from its seed alone."""
    return run_conditions(learn(seed, arena), steps)


def replicates(seeds: Sequence[int], arena: str | int, steps: int) -> Iterator[dict[str, Scores]]:
    """Yield replicates in the order of their seeds, run on all cores."""
    if not seeds:
        return
    with processes() as pool:
        jobs = [pool.submit(replicate, seed, arena, steps) for seed in seeds]
        for job in tqdm(jobs, "replicates", unit="replicate"):
            yield job.result()


Run = Callable[[Learned, int], Scores]


def _conditions(learned: Learned) -> dict[str, list[Run]]:
    """Return name -> runs; all but the teacher's begin at the same place in the open."""
    taught = _driven_by(lambda: learned.network)
    unseen = [
        _driven_by(lambda: learned.network, Place(UNSEEN_ARENAS + UNSEEN * learned.seed + number))
        for number in range(UNSEEN)
    ]
    return {
        "recall": [taught],
        "recall in unseen arenas": unseen,
        "recall beside a left wall": [_run_beside("left")],
        "recall beside a right wall": [_run_beside("right")],
        "wandering": [_run_wandering],
        "teacher's controller": [_run_teacher("left"), _run_teacher("right")],
        "50-NN over all frames, no map": [_run_nearest],
        "one constant target": [_driven_by(lambda: constant_target(learned))],
        "shuffled targets": [_driven_by(lambda: shuffled_targets(learned))],
        "node's mean action": [_driven_by(lambda: mean_action(learned))],
        "untrained forward model": [_with(untrained)],
        "transition matrix": [_with(transition_matrix)],
        "speed free": [_with(speed_free)],
        "noise doubled": [_driven_by(lambda: learned.network, Place(learned.arena, noise=2.0))],
        "taught on one side": [_run_taught_on(index) for index in range(len(TAUGHT_SIDES))],
    }


def _with(make: Callable[[Learned], ForwardModel]) -> Run:
    """Return a run with another forward model."""

    def run(learned: Learned, steps: int) -> Scores:
        network = with_forward_model(learned, make(learned))
        return _score(learned, Recalling(network, learned.seed), steps, None, network)

    return run


def _driven_by(make: Callable[[], PACNet], place: Place | None = None) -> Run:
    def run(learned: Learned, steps: int) -> Scores:
        network = make()
        driver = Recalling(network, learned.seed)
        return _score(learned, driver, steps, place, network)

    return run


def _run_beside(side: Side) -> Run:
    """Return a run that begins beside a wall, and scores whether it keeps that side."""

    def run(learned: Learned, steps: int) -> Scores:
        driver = Recalling(learned.network, learned.seed)
        place = Place(learned.arena, wall=side)
        run = act_alone(driver, place, alone_seed(learned.seed), steps)
        return score_run(run) | {"side_kept": side_kept(run, SIDES[side])}

    return run


def _run_wandering(learned: Learned, steps: int) -> Scores:
    return _score(learned, Wandering(learned.seed), steps)


def _run_nearest(learned: Learned, steps: int) -> Scores:
    """Run the mean of as many targets as a schema averages, over everything that was followed."""
    cues, targets = frames(learned.episodes)
    model = fitted_model(learned)
    driver = NearestTargets(cues, targets, min(NEAREST_CUES, len(cues)), model, learned.seed)
    return _score(learned, driver, steps)


def _run_teacher(side: Side) -> Run:
    def run(learned: Learned, steps: int) -> Scores:
        place = Place(learned.arena, wall=side)
        return _score(learned, Teacher(side), steps, place)

    return run


def _run_taught_on(index: int) -> Run:
    """Return a run of a network taught on one side, and score whether it keeps that side."""

    def run(learned: Learned, steps: int) -> Scores:
        network = make_network(fitted_model(learned))
        episodes = [episode for episode in learned.episodes if episode.side == index]
        teach(network, episodes, leave_bar=False)
        driver = Recalling(network, learned.seed)
        run = act_alone(driver, Place(learned.arena), alone_seed(learned.seed), steps)
        return score_run(run) | {"side_kept": side_kept(run, SIDES[TAUGHT_SIDES[index]])}

    return run


def _score(
    learned: Learned,
    driver: Driver,
    steps: int,
    place: Place | None = None,
    network: PACNet | None = None,
) -> Scores:
    """Run a driver alone and return its scores; a network's include its clusters."""
    place = Place(learned.arena) if place is None else place
    run = act_alone(driver, place, alone_seed(learned.seed), steps)
    scores = score_run(run)
    if network is None:
        return scores
    names = name_clusters(network.sofm.prototypes.numpy())
    return scores | {
        "nodes": float(len(names)),
        "cluster_agreement": cluster_agreement(run, names),
    }


def _mean(scores: Sequence[Scores]) -> Scores:
    return {name: sum(one[name] for one in scores) / len(scores) for name in scores[0]}
