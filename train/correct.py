"""Correct an imitator in situations that are novel to it.

The imitator acts in the drinking environment, with the glass at known places and at new ones, 15 cm
away. When a percept is novel, the imitator reports the dimension and the deviation, and holds
still for as long as it is. If it does not succeed, the demonstrator demonstrates the task in the
same situation. The demonstration is recorded and learned in addition to what is known. This repeats
until the imitator succeeds.

Writes the dataset with the corrections appended, the checkpoint that learned them, a figure and the
scores of new episodes before and after into `runs/correct/<time>-seed<N>/`. The given dataset and
checkpoint are not changed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from envs.glass_offset import draw_offset
from envs.postural_imitation import PosturalImitationEnv
from envs.scene import CONTROL_TIMESTEP
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.imitator.imitator import Imitator
from pacnet.kernels.threads import use_one_thread
from train.common.runs import command_line, make_parser, run_folder, save_figures, write_metrics
from train.postural.correction.episodes import (
    COLUMNS,
    USUAL,
    Attempt,
    Offset,
    Situation,
    Turn,
    annotate,
    as_demonstration,
    attempt,
    attempts,
    columns_of,
    demonstrate,
)
from train.postural.correction.figures import novelty_over_time
from train.postural.correction.scores import print_scores, print_turn, score_attempts, score_turn
from train.postural.episodes import FPS, TASK, Condition, make_environment
from train.postural.learning import FEATURES

DISTANCE = 0.15  # [m] between a new place and the usual one
ENOUGH = 5  # consecutive attempts at a new place without a correction
ATTEMPTS = 20  # most at a place

# Purposes for which seeds are drawn.
_PLACES, _ELSEWHERE, _KNOWN, _NEW, _CORRECTING, _CORRECTED, _OTHERS, _STILL_NEW = range(10, 18)


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.correct", __doc__, episodes=50)
    parser.add_argument("checkpoint", help="folder of an imitator, written by `pacnet fit`")
    parser.add_argument(
        "--dataset", required=True, help="folder of the LeRobot dataset that it learned from"
    )
    parser.add_argument(
        "--places",
        type=int,
        choices=(1, 2, 3),
        default=1,
        help="number of new places at which it is corrected",
    )
    return parser.parse_args()


def main() -> None:
    """Load the imitator and its dataset, check both, and run the experiment."""
    arguments = parse_arguments()
    try:
        imitator = Imitator.from_pretrained(arguments.checkpoint).eval()
        given = load_demonstrations(arguments.dataset)
        check(imitator, given)
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}") from error
    with run_folder("correct", arguments.seed, arguments.runs) as folder:
        run(arguments, imitator, given, folder)


def check(imitator: Imitator, given: Demonstrations) -> None:
    """Refuse an imitator for another environment, or the dataset of another environment."""
    config = imitator.config
    if {**config.percepts, "action": config.action} != FEATURES or config.targets != "action":
        raise ValueError(
            f"expected an imitator of the drinking environment with percepts and actions "
            f"{', '.join(FEATURES)} whose targets are actions, got one with "
            f"{', '.join(config.percepts)} whose targets are {config.targets}s"
        )
    if not imitator.reports:
        raise ValueError("expected an imitator that has learned something, got one that has not")
    if dict(given.names) != FEATURES or given.fps != FPS:
        raise ValueError(
            f"expected the features of the drinking environment at {FPS} frames per second, "
            f"got {', '.join(given.names)} at {given.fps}"
        )


def run(
    arguments: argparse.Namespace, imitator: Imitator, given: Demonstrations, folder: Path
) -> None:
    """Run episodes before the corrections, correct the imitator, and run episodes after."""
    use_one_thread()
    seed, count = arguments.seed, arguments.episodes
    places = draw_places((seed, _PLACES), arguments.places)
    known = situations((seed, _KNOWN), [USUAL], count)
    elsewhere = [draw_places((seed, _ELSEWHERE, i), 1)[0] for i in range(count)]
    new = situations((seed, _NEW), elsewhere, count)
    others = [draw_other_place((seed, _OTHERS, i), places) for i in range(count)]
    still_new = situations((seed, _STILL_NEW), others, count)
    corrected = situations((seed, _CORRECTED), places, count)

    before = {
        "known places, before": attempts(arguments.checkpoint, known, "known places"),
        "new places, before": attempts(arguments.checkpoint, new, "new places"),
    }
    turns = correct(imitator, given, places, seed, folder / "dataset")
    imitator.save_pretrained(folder / "checkpoint")
    after = {
        "known places, after": attempts(folder / "checkpoint", known, "known places"),
        "corrected places, after": attempts(folder / "checkpoint", corrected, "corrected places"),
        "new places, after": attempts(folder / "checkpoint", still_new, "other new places"),
    }

    write_scores(arguments, folder, places, turns, before | after)
    shown = {name: before[f"{name}s, before"][0] for name in ("known place", "new place")}
    save_figures(folder, {"novelty": novelty_over_time(shown, CONTROL_TIMESTEP)})
    print(f"\nscores      {folder / 'metrics.json'}\nfigure      {folder / 'novelty.png'}")
    print(f"checkpoint  {folder / 'checkpoint'}\ndataset     {folder / 'dataset'}")


def write_scores(
    arguments: argparse.Namespace,
    folder: Path,
    places: list[Offset],
    turns: list[Turn],
    kinds: Mapping[str, list[Attempt]],
) -> None:
    """Print the scores of all episodes and of the corrections; write `metrics.json`."""
    scores = {kind: score_attempts(episodes) for kind, episodes in kinds.items()}
    learning = [turn.learning for turn in turns if turn.learning is not None]
    corrections = {
        "places_m": places,
        "corrections": len(learning),
        "learning_s_max": max(learning, default=None),
        "session": [score_turn(turn) for turn in turns],
    }
    command = command_line("train.correct", arguments)
    write_metrics(folder / "metrics.json", command, arguments.seed, scores | corrections)
    print_scores(scores)


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
    environment, turns = make_environment(Condition()), []
    with Recorder(dataset, FPS, COLUMNS, "postural_imitation") as recorder:
        for shown in tqdm(given, "copying the dataset", unit="episode"):
            done = np.arange(len(shown.state)) == len(shown.state) - 1
            recorder.save_episode(shown.task, columns_of(shown) | annotate(imitator, shown, done))
        teacher = Teacher(imitator, environment, recorder, given)
        turns.append(teacher.take_turn(0, situations((seed, _CORRECTING), [USUAL], 1)[0]))
        for place, offset in enumerate(places, 1):
            for situation in situations((seed, _CORRECTING, place), [offset], ATTEMPTS):
                turns.append(teacher.take_turn(place, situation))
                latest = [turn for turn in turns if turn.place == place][-ENOUGH:]
                if len(latest) == ENOUGH and all(turn.attempt.is_autonomous for turn in latest):
                    break
    return turns


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


def draw_places(seed: Sequence[int], count: int) -> list[Offset]:
    """Draw offsets of new places [m]; they and the usual one are at least `DISTANCE` apart."""
    rng = np.random.default_rng(seed)
    while True:
        places = np.stack([draw_offset(rng, DISTANCE) for _ in range(count)])
        apart = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(count, 1)]
        if (apart >= DISTANCE).all():
            return [(x, y) for x, y in places.tolist()]


def draw_other_place(seed: Sequence[int], corrected: Sequence[Offset]) -> Offset:
    """Draw the offset of another new place [m], away from those that were corrected."""
    rng = np.random.default_rng(seed)
    while True:
        place = draw_offset(rng, DISTANCE)
        if np.linalg.norm(place - np.array(corrected), axis=1).min() >= DISTANCE / 2:
            return (float(place[0]), float(place[1]))


def situations(seed: Sequence[int], places: Sequence[Offset], count: int) -> list[Situation]:
    """Return `count` situations with different seeds, cycling through the places."""
    seeds = np.random.SeedSequence(seed).generate_state(count).tolist()
    return [Situation(number, places[i % len(places)]) for i, number in enumerate(seeds)]


if __name__ == "__main__":
    main()
