"""Compare what is worth remembering where memory is bounded.

The frames that an `Imitator` with a budget keeps are compared with those that maps, a reservoir,
k-means and every n-th frame keep: who acts alone on them, and how far off is the target of the
nearest? Drinks are shown plainly, with a minute of rest before each, with one toast among twenty,
and with three times the noise; walls are followed by a teacher that stops for a minute now and
then. Writes scores, a figure and a tensorboard log into `runs/memory/<time>-seed<N>/`.
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
from train.postural.alone.learning import load_body
from train.remembering.replicates import ALONE, CUES, EXPERIMENTS, run_replicates
from train.remembering.report import draw, print_tables


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.memory", __doc__, episodes=5)
    add_arguments(parser, replicates=1)
    parser.add_argument(
        "--only", choices=EXPERIMENTS, help="one of the three experiments, instead of all"
    )
    return parser.parse_args()


def main() -> None:
    """Load the body, make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    body = load_body(arguments.body)
    with run_folder("memory", arguments.seed, arguments.runs) as folder:
        run(arguments, body, folder)


def run(arguments: argparse.Namespace, body: KinematicModel, folder: Path) -> None:
    """Run every replicate; write their scores, means and a figure."""
    use_one_thread()
    chosen = EXPERIMENTS if arguments.only is None else (arguments.only,)
    replicates = run_replicates(seeds_of(arguments), arguments.episodes, body, chosen)
    scores = record_replicates("train.memory", arguments, folder, replicates, _figures)
    print_tables(scores)
    print_places(folder)


def _figures(scores: Scores) -> Mapping[str, Figure]:
    return {"memory": draw(scores)} if {ALONE, CUES} <= scores.keys() else {}


if __name__ == "__main__":
    main()
