"""Experiment 1 in a world that changes: the glass is put down elsewhere, then a toast comes first.

No frame of reference explains where the glass goes now: it is 10 cm beside where it was taken. Each
stage is what has been shown so far. A learner imitates a demonstrator that it watches, or acts
alone with its own glass at its usual place; then nothing but a name tells it what is wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from envs.humanoid import JOINTS
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import Imitator, PACNet
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from train.behaviours import make_competing_network
from train.postural.alone.actors import Actor, Alone, make_actor
from train.postural.alone.episodes import act
from train.postural.alone.scenes import COPYING, Scene
from train.postural.behaviours.episodes import TASKS
from train.postural.episodes import (
    FPS,
    Condition,
    make_environment,
    recall_episode,
    recall_seeds,
    watch_demonstration,
)
from train.postural.learning import NOVELTY_THRESHOLD, frames_of, make_network

OLD, NEW, THIRD = "drink", "aside", "toast"
ONE_WORLD, AFTER_TWO, BOTH, ALL = "one world", "2 of the new way", "both again", "all again"
WINDOW = 2  # last demonstrations that a sliding window keeps

_CHANGING = 4  # purpose for which seeds are drawn


class Stage(NamedTuple):
    """What has been shown so far, in this order, and what the learner is then to do."""

    shown: tuple[str, ...]
    wanted: tuple[str, ...]

    @property
    def settled(self) -> tuple[str, ...]:
        """Return the way that the world has now, if the last demonstrations agree about it."""
        changed = self.shown[: len(_FIRST)] != self.shown
        agree = len(set(self.shown[-WINDOW:])) == 1 or self.shown[-1] not in self.shown[:-1]
        return self.shown[-1:] if changed and agree else ()


_FIRST = (OLD,) * 5
STAGES = {
    ONE_WORLD: Stage(_FIRST, ()),
    "1 of the new way": Stage((*_FIRST, NEW), (NEW,)),
    AFTER_TWO: Stage((*_FIRST, NEW, NEW), (NEW, OLD)),
    "4 of the new way": Stage((*_FIRST, *(NEW,) * 4), (NEW,)),
    BOTH: Stage((*_FIRST, NEW, NEW, OLD, NEW), (NEW, OLD)),
    "2 of a third way": Stage((*_FIRST, *(NEW,) * 4, THIRD, THIRD), (THIRD,)),
    ALL: Stage((*_FIRST, *(NEW,) * 4, THIRD, THIRD, OLD, NEW, THIRD), (OLD, NEW, THIRD)),
}

OVERWRITING, SEVERAL = "watching, overwriting", "watching, several schemas"
WATCHING_LAST, COPYING_IT = f"watching, last {WINDOW}", "copying what it watches"
EVERYTHING, LAST = "alone, everything", f"alone, last {WINDOW}"
NAMED, NAMED_LAST = f"alone, last {WINDOW}, named", f"alone, last {WINDOW} of each name"
ROWS = (OVERWRITING, SEVERAL, WATCHING_LAST, COPYING_IT, EVERYTHING, LAST, NAMED, NAMED_LAST)

_NETWORKS: dict[str, tuple[Callable[[], PACNet], int | None]] = {  # and what is kept
    OVERWRITING: (lambda: make_network(NOVELTY_THRESHOLD), None),
    SEVERAL: (make_competing_network, None),
    WATCHING_LAST: (lambda: make_network(NOVELTY_THRESHOLD), WINDOW),
}
_TASKS = {OLD: TASKS[OLD], NEW: "drink a glass of beer and put it aside", THIRD: TASKS[THIRD]}


def show(seed: int) -> dict[str, list[Demonstration]]:
    """Return demonstrations of each behaviour, as many as the stages show at most."""
    most = {name: max(stage.shown.count(name) for stage in STAGES.values()) for name in _TASKS}
    seeds = iter(np.random.SeedSequence([seed, _CHANGING]).generate_state(sum(most.values())))
    shown = {}
    for name, count in most.items():
        environment = make_environment(Condition(behaviour=name))
        watched = [watch_demonstration(environment, int(next(seeds))) for _ in range(count)]
        shown[name] = [_demonstration(percepts, _TASKS[name]) for percepts in watched]
        environment.close()
    return shown


def _demonstration(percepts: NDArray[np.float32], task: str) -> Demonstration:
    state, glass, action = (torch.from_numpy(rows) for rows in frames_of(percepts).values())
    return Demonstration(0, task, state, glass, action)


def shown_in(stage: Stage, shown: Mapping[str, Sequence[Demonstration]]) -> list[Demonstration]:
    """Return what a stage shows, in order and numbered; each is shown once."""
    turns = {name: iter(some) for name, some in shown.items()}
    return [replace(next(turns[name]), episode=number) for number, name in enumerate(stage.shown)]


def watch_and_imitate(seed: int, episodes: int) -> dict[str, float]:
    """Return "stage | row | score" -> value, of networks that watch while they imitate.

    Scores: `targets` that are kept, and for each behaviour that is wanted the share of episodes in
    which it succeeds.
    """
    scenes, shown, scores = _Scenes(recall_seeds(seed, episodes)), show(seed), {}
    for name, stage in STAGES.items():
        demonstrations = shown_in(stage, shown)
        for row, (make, kept) in _NETWORKS.items():
            if row == WATCHING_LAST and len(stage.wanted) == 1:
                continue  # it has seen little but that
            network = make()
            for one in demonstrations[-(kept or 0) :]:
                network.observe(one.percepts, one.action, one.episode, one.task)
            scores[f"{name} | {row} | targets"] = float(network.schemas.lengths.sum())
            for wanted in stage.wanted:
                scores[f"{name} | {row} | {wanted}"] = scenes.imitate(network.eval(), wanted)
    for wanted in STAGES[ALL].wanted:
        copying = make_actor(COPYING, Path())
        scores[f"{ALL} | {COPYING_IT} | {wanted}"] = scenes.act(copying, wanted, "present")
    return scores


def act_alone(seed: int, episodes: int, body: KinematicModel) -> dict[str, float]:
    """Return the same of imitators that act alone with a body model.

    Without names they can only be wanted to do what was shown last, if the last ones agree. With
    names they can be asked for each way of which they keep a demonstration.
    """
    scenes, shown, scores = _Scenes(recall_seeds(seed, episodes)), show(seed), {}
    for name, stage in STAGES.items():
        named = shown_in(stage, shown)
        unnamed = [replace(one, task=_TASKS[OLD]) for one in named]
        rows = {EVERYTHING: unnamed, LAST: unnamed[-WINDOW:]}
        if not stage.settled:  # several ways may be wanted, so they need names
            rows |= {NAMED: named[-WINDOW:], NAMED_LAST: _last(named)}
        for row, kept in rows.items():
            imitator = _teach(kept, body)
            scores[f"{name} | {row} | targets"] = float(sum(len(one.action) for one in kept))
            for wanted in stage.settled if row in (EVERYTHING, LAST) else stage.wanted:
                task = None if row in (EVERYTHING, LAST) else _TASKS[wanted]
                if task is None or task in imitator.tasks:
                    success = scenes.act(Alone(imitator, task), wanted, "absent")
                    scores[f"{name} | {row} | {wanted}"] = success
    return scores


def _last(demonstrations: Sequence[Demonstration]) -> list[Demonstration]:
    """Return the last demonstrations of each task."""
    of_task = {
        one.task: [o for o in demonstrations if o.task == one.task] for one in demonstrations
    }
    return [one for some in of_task.values() for one in some[-WINDOW:]]


def _teach(kept: Sequence[Demonstration], body: KinematicModel) -> Imitator:
    features = {
        "observation.state": STATE_NAMES,
        "observation.environment_state": GLASS_NAMES,
        "action": JOINTS,
    }
    demonstrations = Demonstrations(FPS, features, tuple(kept), "drinks")
    imitator = Imitator.from_demonstrations(demonstrations, body=body)
    imitator.learn(demonstrations)
    return imitator.eval()


class _Scenes:
    """An environment for each behaviour, and the seeds of the episodes in it."""

    def __init__(self, seeds: Sequence[int]) -> None:
        self._seeds = seeds
        self._environments = {name: make_environment(Condition(behaviour=name)) for name in _TASKS}

    def imitate(self, network: PACNet, wanted: str) -> float:
        """Return the share of episodes in which a network does what it watches."""
        environment = self._environments[wanted]
        return _mean([recall_episode(network, environment, s).success for s in self._seeds])

    def act(self, actor: Actor, wanted: str, presence: str) -> float:
        """Return the share of episodes in which an actor does what is wanted."""
        environment, scene = self._environments[wanted], Scene((), presence, radius=0.0)
        return _mean([act(actor, environment, scene, s).success for s in self._seeds])


def _mean(successes: Sequence[bool]) -> float:
    return float(np.mean(successes))
