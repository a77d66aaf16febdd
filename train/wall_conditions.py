"""What causes the behaviour: recall of Experiment 2 beside variants that each lack one thing.

A replicate has its own wandering, forward model, demonstrations and map, all drawn from its seed.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from tqdm import tqdm

from envs.wall_behaviours import Side
from pacnet import (
    Command,
    ForwardModel,
    MLPForwardModel,
    PACNet,
    TransitionMatrix,
    TransitionMatrixConfig,
)
from train.runs import UNSEEN_ARENAS
from train.wall_episodes import (
    TAUGHT_SIDES,
    Driver,
    Place,
    Recalling,
    Teacher,
    Transitions,
    Wandering,
    act_alone,
    alone_seed,
    wander,
)
from train.wall_learning import (
    LESSON,
    TRANSITIONS,
    Episode,
    fit,
    follow_both_sides,
    make_forward_model,
    make_network,
    teach,
)
from train.wall_scores import SIDES, cluster_agreement, name_clusters, score_run, side_kept

STEPS = 2500  # of a run
UNSEEN = 3  # arenas
FREE_SPEEDS = (0.0, 0.03, 0.06, 0.07)  # [m/s] of the candidates where the speed is free

Scores = dict[str, float]


@dataclass(frozen=True, eq=False)
class Learned:
    """What one replicate learned and from what.

    Attributes:
        seed: of the replicate.
        arena: where it learned.
        wandering: from which the forward model was fitted.
        episodes: of following.
        network: taught, with the forward model.
    """

    seed: int
    arena: str | int
    wandering: Transitions
    episodes: Sequence[Episode]
    network: PACNet


class Repeat(nn.Module):
    """A forward model of nothing: the target is the action."""

    action_dimensions = 2

    def command(self, states: Tensor, targets: Tensor) -> Command:
        """The targets themselves `[B, U]`."""
        return Command(targets, torch.ones(len(states), dtype=torch.bool))

    def reset(self) -> None:
        """Does nothing."""


def learn(seed: int, arena: str | int) -> Learned:
    """Wanders, fits, follows and observes, without writing anything."""
    wandering = wander(arena, TRANSITIONS, seed)
    model = make_forward_model(seed)
    fit(model, wandering, seed)
    network = make_network(model)
    episodes = follow_both_sides(arena, seed)
    teach(network, episodes)
    return Learned(seed, arena, wandering, episodes, network)


def run_conditions(learned: Learned, steps: int = STEPS) -> dict[str, Scores]:
    """Scores of every condition; where one is run several times, their mean."""
    conditions = _conditions(learned)
    scores = {}
    with tqdm(total=len(conditions), desc="conditions", unit="condition") as progress:
        for name, runs in conditions.items():
            progress.set_postfix_str(name)
            scores[name] = _mean([run(learned, steps) for run in runs])
            progress.update()
    return scores


def replicate(seed: int, arena: str | int, steps: int = STEPS) -> dict[str, Scores]:
    """A replicate from its seed alone."""
    return run_conditions(learn(seed, arena), steps)


def replicates(seeds: Sequence[int], arena: str | int, steps: int) -> Iterator[dict[str, Scores]]:
    """Replicates in the order of their seeds, on all cores; their number changes nothing."""
    if not seeds:
        return
    cores = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1, 8)
    pool = ProcessPoolExecutor(cores, multiprocessing.get_context("spawn"), _start_worker)
    jobs = [pool.submit(replicate, seed, arena, steps) for seed in seeds]
    try:
        for job in tqdm(jobs, "replicates", unit="replicate"):
            yield job.result()
    except BaseException:
        for worker in multiprocessing.active_children():
            worker.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


Run = Callable[[Learned, int], Scores]


def _conditions(learned: Learned) -> dict[str, list[Run]]:
    """Name -> its runs. All begin at the same place in the open, but for the teacher."""
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
        "one constant target": [_driven_by(lambda: _constant_target(learned))],
        "shuffled targets": [_driven_by(lambda: _shuffled_targets(learned))],
        "node's mean action": [_driven_by(lambda: _mean_action(learned))],
        "untrained forward model": [_driven_by(lambda: _with(learned, _untrained(learned)))],
        "no abstention": [_driven_by(lambda: _with(learned, _never_abstaining(learned)))],
        "transition matrix": [_driven_by(lambda: _with(learned, _matrix(learned)))],
        "speed free": [_driven_by(lambda: _with(learned, _speed_free(learned)))],
        "noise doubled": [_driven_by(lambda: learned.network, Place(learned.arena, noise=2.0))],
        "taught on one side": [_run_taught_on(index) for index in range(len(TAUGHT_SIDES))],
    }


def _driven_by(make: Callable[[], PACNet], place: Place | None = None) -> Run:
    def run(learned: Learned, steps: int) -> Scores:
        network = make()
        driver = Recalling(network, learned.seed)
        return _score(learned, driver, steps, place, network)

    return run


def _run_beside(side: Side) -> Run:
    """Begins beside a wall: does it keep that side?"""

    def run(learned: Learned, steps: int) -> Scores:
        driver = Recalling(learned.network, learned.seed)
        place = Place(learned.arena, wall=side)
        run = act_alone(driver, place, alone_seed(learned.seed), steps)
        return score_run(run) | {"side_kept": side_kept(run, SIDES[side])}

    return run


def _run_wandering(learned: Learned, steps: int) -> Scores:
    return _score(learned, Wandering(learned.seed), steps)


def _run_teacher(side: Side) -> Run:
    def run(learned: Learned, steps: int) -> Scores:
        place = Place(learned.arena, wall=side)
        return _score(learned, Teacher(side), steps, place)

    return run


def _run_taught_on(index: int) -> Run:
    """Taught on one side alone: does it keep it?"""

    def run(learned: Learned, steps: int) -> Scores:
        network = make_network(learned.network.forward_model)
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
    """A run alone and its scores; a network's also by its clusters."""
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


def _with(learned: Learned, forward_model: ForwardModel) -> PACNet:
    """The taught network with another forward model."""
    network = deepcopy(learned.network)
    network.forward_model = forward_model
    return network


def _with_targets(learned: Learned, change: Callable[[Tensor], Tensor]) -> PACNet:
    """The taught network with other targets `[P, 6]` in the place of its own."""
    network = deepcopy(learned.network)
    every = [network.schemas.targets(node) for node in range(len(network.schemas))]  # views
    changed = change(torch.cat(every)).split([len(targets) for targets in every])
    for targets, others in zip(every, changed, strict=True):
        targets.copy_(others)
    return network


def _constant_target(learned: Learned) -> PACNet:
    return _with_targets(learned, lambda targets: targets.mean(dim=0).expand_as(targets))


def _shuffled_targets(learned: Learned) -> PACNet:
    """Every node has the targets of another, of which each of its cues gets one by chance."""
    network = deepcopy(learned.network)
    own, schemas = learned.network.schemas, network.schemas
    generator = torch.Generator().manual_seed(learned.seed)
    nodes = own.lengths.nonzero().flatten()  # that have any
    nodes = nodes[torch.randperm(len(nodes), generator=generator)]
    for node, other in zip(nodes.tolist(), nodes.roll(1).tolist(), strict=True):
        theirs, mine = own.targets(other), schemas.targets(node)  # views
        mine.copy_(theirs[torch.randint(len(theirs), (len(mine),), generator=generator)])
    return network


def _mean_action(learned: Learned) -> PACNet:
    """Each node repeats the mean of the actions that the learner made where the node won."""
    network = make_network(Repeat(), targets=2)
    for episode in learned.episodes:
        network.observe(episode.percepts, episode.actions, LESSON)
    for node in range(len(network.schemas)):
        actions = network.schemas.targets(node)  # a view
        actions.copy_(actions.mean(dim=0).expand_as(actions))
    return network.eval()


def _untrained(learned: Learned) -> MLPForwardModel:
    return make_forward_model(learned.seed)


def _never_abstaining(learned: Learned) -> MLPForwardModel:
    fitted = _forward_model(learned)
    model = MLPForwardModel(replace(fitted.config, abstain_below=0.0))
    model.load_state_dict(fitted.state_dict())
    return model


def _speed_free(learned: Learned) -> MLPForwardModel:
    model = make_forward_model(learned.seed, FREE_SPEEDS)
    model.load_state_dict(_forward_model(learned).state_dict())
    return model


def _matrix(learned: Learned) -> TransitionMatrix:
    """The paper's own forward model, from the same transitions."""
    config = _forward_model(learned).config
    model = TransitionMatrix(
        TransitionMatrixConfig(
            config.state_dimensions,
            config.action_dimensions,
            config.candidates[
                1::3
            ],  # seven, one of them straight: with more, too few transitions would be left for each
            steps=config.steps,
            abstain_below=config.abstain_below,
        )
    )
    percepts, actions = map(torch.from_numpy, learned.wandering)
    model.fit(percepts[:-1], actions[:-1], percepts[1:], seed=learned.seed)
    return model


def _forward_model(learned: Learned) -> MLPForwardModel:
    model = learned.network.forward_model
    assert isinstance(model, MLPForwardModel)
    return model


def _mean(scores: Sequence[Scores]) -> Scores:
    return {name: sum(one[name] for one in scores) / len(scores) for name in scores[0]}


def _start_worker() -> None:
    sys.stderr = open(os.devnull, "w")  # noqa: PTH123, SIM115  # their bars would mix with ours
    torch.set_num_threads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Ends this worker when its parent was killed: nobody would take the result."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
