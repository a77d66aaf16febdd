"""Corrects an imitator where it finds a situation new: it pauses, is shown what to do, and goes on.

The imitator acts in the drinking environment, with the glass at known places and at new ones, 15 cm
away. Where something is new to it, it says what and by how much, and holds still. The demonstrator
then shows, in this very situation, what is to be done; the demonstration is recorded, and learned
beside all that is known. So it goes on until the imitator does there by itself what it is shown.

Writes the dataset with the corrections appended, the checkpoint that learned them, the figures and
the scores of new episodes before and after into `runs/correct/<time>-seed<N>/`. The dataset and the
checkpoint that were given stay as they are.
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
from train.postural.episodes import TASK, Condition, make_environment
from train.postural.report import FPS
from train.postural_imitation import FEATURES

DISTANCE = 0.15  # [m] of a new place from the usual one
ENOUGH = 5  # attempts at a new place, one after the other, that need no correction
ATTEMPTS = 20  # there, at most

# What is drawn from the seed.
_PLACES, _ELSEWHERE, _KNOWN, _NEW, _CORRECTING, _CORRECTED, _OTHERS, _STILL_NEW = range(10, 18)


def parse_arguments() -> argparse.Namespace:
    """The command line."""
    parser = make_parser("train.correct", __doc__, episodes=50)
    parser.add_argument("checkpoint", help="folder of an imitator, as `pacnet fit` writes it")
    parser.add_argument(
        "--dataset", required=True, help="folder of the LeRobot dataset that it learned from"
    )
    parser.add_argument(
        "--places",
        type=int,
        choices=(1, 2, 3),
        default=1,
        help="new places at which it is corrected, as far from one another as from the usual one",
    )
    return parser.parse_args()


def main() -> None:
    """Load, act, correct, show."""
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
    """Refuses an imitator that does not act in the drinking environment, or another's dataset."""
    config = imitator.config
    if {**config.percepts, "action": config.action} != FEATURES or config.targets != "action":
        raise ValueError(
            f"expected an imitator that perceives {', '.join(FEATURES)} of the drinking "
            f"environment and keeps actions, got one of {', '.join(config.percepts)} that keeps "
            f"{config.targets}s"
        )
    if not imitator.lessons:
        raise ValueError("expected an imitator that has learned something, got one without lessons")
    if dict(given.names) != FEATURES or given.fps != FPS:
        raise ValueError(
            f"expected the features of the drinking environment at {FPS} frames per second, "
            f"got {', '.join(given.names)} at {given.fps}"
        )


def run(
    arguments: argparse.Namespace, imitator: Imitator, given: Demonstrations, folder: Path
) -> None:
    """Episodes before, the corrections, episodes after."""
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
    """Scores of each kind of episodes and of the corrections, as a table and in `metrics.json`."""
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
    """Lets the imitator act, first at the usual place, and corrects it at each new one.

    Args:
        imitator: learns the corrections.
        given: what it learned before.
        places: new ones.
        seed: of the run.
        dataset: folder to be made, for the given demonstrations and then the corrections.
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
                if len(latest) == ENOUGH and all(turn.attempt.needs_nobody for turn in latest):
                    break
    return turns


class Teacher:
    """Shows the imitator what to do wherever it does not know by itself.

    Args:
        imitator: acts, and learns.
        environment: to act and to show in.
        recorder: of what is shown.
        given: what the imitator learned before.
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
        """Lets the imitator act in a situation, and corrects it if it paused or did not succeed."""
        tried = attempt(self._imitator, self._environment, situation)
        turn = Turn(place, tried, None if tried.needs_nobody else self._correct(situation))
        print_turn(turn)
        return turn

    def _correct(self, situation: Situation) -> float:
        """Shows, records and has the imitator learn; the time of learning [s]."""
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
    """Offsets of new places [m], no two of them nearer to one another than to the usual one."""
    rng = np.random.default_rng(seed)
    while True:
        places = np.stack([draw_offset(rng, DISTANCE) for _ in range(count)])
        apart = np.linalg.norm(places[:, None] - places, axis=2)[np.triu_indices(count, 1)]
        if (apart >= DISTANCE).all():
            return [(x, y) for x, y in places.tolist()]


def draw_other_place(seed: Sequence[int], corrected: Sequence[Offset]) -> Offset:
    """The offset of one more new place [m], not near those at which it was corrected."""
    rng = np.random.default_rng(seed)
    while True:
        place = draw_offset(rng, DISTANCE)
        if np.linalg.norm(place - np.array(corrected), axis=1).min() >= DISTANCE / 2:
            return (float(place[0]), float(place[1]))


def situations(seed: Sequence[int], places: Sequence[Offset], count: int) -> list[Situation]:
    """So many situations, at one place after the other, each of another seed."""
    seeds = np.random.SeedSequence(seed).generate_state(count).tolist()
    return [Situation(number, places[i % len(places)]) for i, number in enumerate(seeds)]


if __name__ == "__main__":
    main()
