"""Trials: at one place of the glasses, everybody acts in every scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pacnet.evaluation.metrics import aligned_distance
from train.common.pool import share_out
from train.postural.alone.actors import Actor, make_actor
from train.postural.alone.episodes import Outcome, Shown, act, demonstrate, demonstrate_again
from train.postural.alone.scenes import OURS, Scene, draw_place, scenes_of
from train.postural.episodes import Condition, make_environment

EVERY = 2  # samples of a path from one that is aligned to the next
_WORTH_A_POOL = 8  # trials, of seconds each


class Task(NamedTuple):
    """The seed of all episodes at a place, which it decides, within a radius [m]."""

    radius: float
    seed: int


@dataclass(frozen=True, eq=False)
class Trial:
    """What everybody did at one place."""

    seed: int  # of its episodes
    offset: tuple[float, float]  # [m] of the glasses from the usual place
    outcomes: dict[str, dict[str, Outcome]]  # scene -> row -> outcome; percepts of ours only
    distances: dict[str, dict[str, float]]  # [m] of each path from the demonstrator's
    shown: Shown  # by the demonstrator with these seed and place
    floor: float  # [m] of another demonstrator's path at that place


def run_trials(folder: Path, tasks: list[Task]) -> list[Trial]:
    """Return the trials of all tasks, in their order, run on all cores.

    Args:
        folder: Of the run, with the dataset and what was learned from it.
        tasks: Each with a seed of its own, so results do not depend on the number of cores.
    """
    return share_out(_Trials, (folder,), tasks, "acting", "place", worth_a_pool=_WORTH_A_POOL)


class _Trials:
    """Run trials with what was learned, which is loaded when it acts first."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._actors = folder, dict[str, Actor]()
        self._environment = make_environment(Condition())

    def run(self, task: Task) -> Trial:
        offset, scenes = draw_place(task.seed, task.radius), scenes_of(task.radius)
        shown = demonstrate(self._environment, task.seed, offset)
        other = demonstrate_again(self._environment, task.seed, offset)
        outcomes, distances = {}, {}
        for name, scene in scenes.items():
            outcomes[name] = {row: self._act(row, scene, task.seed) for row in scene.rows}
            if scene.is_known:
                done = outcomes[name].items()
                distances[name] = {row: _apart(shown, outcome) for row, outcome in done}
        return Trial(task.seed, offset, outcomes, distances, shown, _apart(shown, other))

    def _act(self, row: str, scene: Scene, seed: int) -> Outcome:
        if row not in self._actors:
            self._actors[row] = make_actor(row, self._folder)
        done = act(self._actors[row], self._environment, scene, seed)
        return done if row == OURS else replace(done, percepts=np.empty((0, 28), np.float32))


def _apart(shown: Shown, done: Shown | Outcome) -> float:
    return aligned_distance(shown.wrist[::EVERY], done.wrist[::EVERY])
