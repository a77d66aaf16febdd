"""Drink alone from pictures: nobody tells where the glass is, a camera beside the head shows it.

Demonstrations are recorded with what a camera beside the demonstrator's head sees, each with its
glass elsewhere within 10 cm. An imitator with a body model learns from 5 and from 20 of them, and
acts on the picture of its own camera, beside simpler rules and beside one that is told where the
glass is. Datasets, imitators, scores, a figure and a film go into `runs/seeing/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from pacnet.forward_models.kinematics import KinematicModel
from pacnet.kernels.threads import use_one_thread
from train.common.replication import (
    Scores,
    add_arguments,
    print_places,
    record_replicates,
    seeds_of,
)
from train.common.runs import make_parser, run_folder
from train.common.summary import mean_and_std
from train.postural.alone.learning import load_body
from train.postural.episodes import recall_seeds
from train.postural.seeing.drawing import beside_the_remembered, film
from train.postural.seeing.trials import (
    COUNTS,
    OURS,
    ROWS,
    cell,
    imitator_of,
    place_of,
    run_replicates,
)

SCORES = {
    "success": "success",
    "absent_is_new": "glass absent, called new before the hand is there",
    "false_alarms": "glass standing, called new in any step",
    "learning_s": "learning [s]",
}


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.seeing", __doc__, episodes=10)
    add_arguments(parser, replicates=1)
    return parser.parse_args()


def main() -> None:
    """Load the body, make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    body = load_body(arguments.body)
    with run_folder("seeing", arguments.seed, arguments.runs) as folder:
        run(arguments, body, folder)


def run(arguments: argparse.Namespace, body: KinematicModel, folder: Path) -> None:
    """Run every replicate; write their scores, a figure and a film."""
    use_one_thread()
    place = place_of(folder, arguments.seed)
    checkpoint = imitator_of(place, OURS, COUNTS[0])
    filmed = recall_seeds(arguments.seed, 1)[0]

    def draw(_: Scores) -> Mapping[str, Figure]:
        return {"seeing": beside_the_remembered(place, checkpoint, COUNTS[0], filmed)}

    replicates = run_replicates(folder, seeds_of(arguments), arguments.episodes, body)
    scores = record_replicates("train.seeing", arguments, folder, replicates, draw)
    film(checkpoint, filmed, folder / "seeing")
    print_tables(scores)
    print_places(folder)
    print(f"film      {folder / 'seeing.mp4'}")


def print_tables(scores: Scores) -> None:
    """Print each score of each row, for each number of demonstrations."""
    for score, title in SCORES.items():
        print(f"\n{title:<52}" + "".join(f"{count:>16}" for count in COUNTS))
        for row in ROWS:
            cells = [scores[cell(row, count)].get(score) for count in COUNTS]
            texts = ["-" if one is None else mean_and_std(one) for one in cells]
            if set(texts) != {"-"}:
                print(f"{row:<52}" + "".join(f"{text:>16}" for text in texts))


if __name__ == "__main__":
    main()
