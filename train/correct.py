"""Correct an imitator in situations that are novel to it.

The imitator acts in the drinking environment, with the glass at known places and at new ones, 15 cm
away. When a percept is novel, the imitator reports the dimension and the deviation, and holds
still for as long as it is. If it does not succeed, the demonstrator demonstrates the task in the
same situation. The demonstration is recorded and learned in addition to what is known. This repeats
until the imitator succeeds.

An imitator with a body of its own acts alone, and knows all places within reach. New to it is a
glass that is out of reach, tipped or absent. It asks for what would help, and acts again once the
glass stands within reach. It is corrected only where it failed at a known place.

Writes the dataset with the corrections appended, the checkpoint that learned them, a figure and the
scores of new episodes before and after into `runs/correct/<time>-seed<N>/`. The given dataset and
checkpoint are not changed.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from envs.scene import CONTROL_TIMESTEP
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.imitator.imitator import Imitator
from pacnet.kernels.threads import use_one_thread
from train.common.runs import command_line, make_parser, run_folder, save_figures, write_metrics
from train.postural.correction.episodes import USUAL, Attempt, Turn, attempts
from train.postural.correction.figures import novelty_over_time
from train.postural.correction.places import alone, draw_other_place, draw_places, situations
from train.postural.correction.scores import (
    print_questions,
    print_scores,
    score_alone,
    score_attempts,
    score_turn,
)
from train.postural.correction.teaching import ATTEMPTS, correct, correct_failures
from train.postural.episodes import FPS
from train.postural.learning import FEATURES

OUT_OF_ORDER = {  # of the own glass, and what an imitator that is alone finds then
    "far": "glass out of reach",
    "tipped": "glass tipped",
    "absent": "no glass",
}

# Purposes for which seeds are drawn; 14 is of `train.postural.correction.teaching`.
_PLACES, _ELSEWHERE, _KNOWN, _NEW = range(10, 14)
_CORRECTED, _OTHERS, _STILL_NEW, _ALONE = range(15, 19)


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
        help="number of new places at which it is corrected; 1 with a body, which reaches them",
    )
    return parser.parse_args()


def main() -> None:
    """Load the imitator and its dataset, check both, and run the experiment."""
    arguments = parse_arguments()
    try:
        imitator = Imitator.from_pretrained(arguments.checkpoint).eval()
        given = load_demonstrations(arguments.dataset)
        check(imitator, given)
        check_places(imitator, arguments.places)
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}") from error
    with run_folder("correct", arguments.seed, arguments.runs) as folder:
        go = run_alone if has_body(imitator) else run
        go(arguments, imitator, given, folder)


def has_body(imitator: Imitator) -> bool:
    """Return whether an imitator has a model of its own body, and acts by itself."""
    frames = imitator.config.frames
    return frames is not None and frames.body is not None


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


def check_places(imitator: Imitator, places: int) -> None:
    """Refuse to correct an imitator with a body at new places: there are none within reach."""
    if has_body(imitator) and places != 1:
        raise ValueError(
            f"expected --places only for an imitator without a body, to which places 15 cm away "
            f"are new; got one that knows all places within reach, and --places {places}"
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

    scores = {kind: score_attempts(episodes) for kind, episodes in (before | after).items()}
    write_scores(arguments, folder, scores, turns, places_m=places)
    shown = {name: before[f"{name}s, before"][0] for name in ("known place", "new place")}
    finish(folder, shown)


def run_alone(
    arguments: argparse.Namespace, imitator: Imitator, given: Demonstrations, folder: Path
) -> None:
    """Let an imitator with a body act alone where its glass is in order, and where it is not."""
    use_one_thread()
    seed, count = arguments.seed, arguments.episodes
    known = alone((seed, _ALONE), count)
    tried = {"known places": attempts(arguments.checkpoint, known, "known places")}
    failed = [one for one, its in zip(known, tried["known places"], strict=True) if not its.success]
    turns, checkpoint = [], Path(arguments.checkpoint)
    if failed:
        turns = correct_failures(imitator, given, failed[:ATTEMPTS], folder / "dataset")
        checkpoint = folder / "checkpoint"
        imitator.save_pretrained(checkpoint)
        tried["known places, after"] = attempts(checkpoint, known, "known places")
    for number, (own_glass, kind) in enumerate(OUT_OF_ORDER.items()):
        asking = alone((seed, _ALONE, number), count, own_glass)
        helped = alone((seed, _ALONE, number), count)  # the same places
        tried[kind] = attempts(checkpoint, asking, kind)
        tried[f"{kind}, helped"] = attempts(checkpoint, helped, f"{kind}, helped")

    scores = {kind: score_alone(episodes) for kind, episodes in tried.items()}
    write_scores(arguments, folder, scores, turns)
    print_questions(scores)
    shown = {kind: tried[kind][0] for kind in ("known places", *OUT_OF_ORDER.values())}
    finish(folder, shown)


def write_scores(
    arguments: argparse.Namespace,
    folder: Path,
    scores: dict[str, dict[str, Any]],
    turns: Sequence[Turn],
    **also: Any,
) -> None:
    """Print kind of episodes -> scores; write them and those of corrections to `metrics.json`."""
    learning = [turn.learning for turn in turns if turn.learning is not None]
    corrections = {
        **also,
        "corrections": len(learning),
        "learning_s_max": max(learning, default=None),
        "session": [score_turn(turn) for turn in turns],
    }
    command = command_line("train.correct", arguments)
    write_metrics(folder / "metrics.json", command, arguments.seed, scores | corrections)
    print_scores(scores)


def finish(folder: Path, shown: Mapping[str, Attempt]) -> None:
    """Draw name -> episode, and print where everything is."""
    save_figures(folder, {"novelty": novelty_over_time(shown, CONTROL_TIMESTEP)})
    print(f"\nscores      {folder / 'metrics.json'}\nfigure      {folder / 'novelty.png'}")
    for name in ("checkpoint", "dataset"):
        if (folder / name).exists():
            print(f"{name:12}{folder / name}")


if __name__ == "__main__":
    main()
