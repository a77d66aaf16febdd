"""A demonstrator corrects an imitator wherever it fails; what it shows is recorded and learned."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from envs.postural_imitation import PosturalImitationEnv
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.imitator.imitator import Imitator
from train.postural.correction.episodes import (
    COLUMNS,
    USUAL,
    Offset,
    Situation,
    Turn,
    annotate,
    as_demonstration,
    attempt,
    columns_of,
    demonstrate,
)
from train.postural.correction.places import situations
from train.postural.correction.scores import print_turn
from train.postural.episodes import FPS, TASK, Condition, make_environment

ENOUGH = 5  # consecutive attempts at a new place without a correction
ATTEMPTS = 20  # most at a place

CORRECTING = 14  # purpose for which seeds are drawn


def correct(
    imitator: Imitator, given: Demonstrations, places: list[Offset], seed: int, dataset: Path
) -> list[Turn]:
    """Let the imitator act at the usual place and at each new one, and correct it there.

    Args:
        imitator: Learns the corrections.
        given: The demonstrations that it has learned.
        places: Offsets of the new places [m].
        seed: Of the run.
        dataset: New folder for the given demonstrations, followed by the corrections.
    """
    turns = []
    with Recorder(dataset, FPS, COLUMNS, "postural_imitation") as recorder:
        teacher = _teacher(imitator, given, recorder)
        turns.append(teacher.take_turn(0, situations((seed, CORRECTING), [USUAL], 1)[0]))
        for place, offset in enumerate(places, 1):
            for situation in situations((seed, CORRECTING, place), [offset], ATTEMPTS):
                turns.append(teacher.take_turn(place, situation))
                latest = [turn for turn in turns if turn.place == place][-ENOUGH:]
                if len(latest) == ENOUGH and all(turn.attempt.is_autonomous for turn in latest):
                    break
    return turns


def correct_failures(
    imitator: Imitator, given: Demonstrations, failed: Sequence[Situation], dataset: Path
) -> list[Turn]:
    """Correct an imitator once in each of the situations in which it failed.

    Args:
        imitator: Learns the corrections.
        given: The demonstrations that it has learned.
        failed: Situations; one in which it succeeds by now is not shown.
        dataset: New folder for the given demonstrations, followed by the corrections.
    """
    with Recorder(dataset, FPS, COLUMNS, "postural_imitation") as recorder:
        teacher = _teacher(imitator, given, recorder)
        return [teacher.take_turn(place, one) for place, one in enumerate(failed, 1)]


def _teacher(imitator: Imitator, given: Demonstrations, recorder: Recorder) -> Teacher:
    """Copy the given demonstrations into the new dataset, and return who continues it."""
    for shown in tqdm(given, "copying the dataset", unit="episode"):
        done = np.arange(len(shown.state)) == len(shown.state) - 1
        recorder.save_episode(shown.task, columns_of(shown) | annotate(imitator, shown, done))
    return Teacher(imitator, make_environment(Condition()), recorder, given)


class Teacher:
    """Demonstrate to the imitator wherever it fails.

    Args:
        imitator: Acts and learns.
        environment: To act and to demonstrate in.
        recorder: Of the demonstrations.
        given: The demonstrations that the imitator has learned.
    """

    def __init__(
        self,
        imitator: Imitator,
        environment: PosturalImitationEnv,
        recorder: Recorder,
        given: Demonstrations,
    ) -> None:
        self._imitator, self._environment, self._recorder = imitator, environment, recorder
        self._given, self._next = given, len(given)

    def take_turn(self, place: int, situation: Situation) -> Turn:
        """Let the imitator act in a situation; correct it if it failed."""
        tried = attempt(self._imitator, self._environment, situation)
        turn = Turn(place, tried, None if tried.is_autonomous else self._correct(situation))
        print_turn(turn)
        return turn

    def _correct(self, situation: Situation) -> float:
        """Demonstrate, record, and let the imitator learn; return the time of learning [s]."""
        frames, done = demonstrate(self._environment, situation)
        shown = as_demonstration(self._next, frames)
        self._recorder.save_episode(TASK, frames | annotate(self._imitator, shown, done))
        self._next += 1
        lesson = Demonstrations(FPS, self._given.names, (shown,), self._given.source)
        began = time.perf_counter()
        self._imitator.train()
        self._imitator.learn(lesson, corrections=True)
        self._imitator.eval()
        return time.perf_counter() - began
