"""Learn in a world that changes, in a way that no frame of reference explains.

In Experiment 2 a sensor's gain drops to a half: how soon are targets right again, and what is lost
of the old, with forgetting (dishabituation), without, with a sliding window, and learned anew? In
Experiment 1 the glass is from some day on put down 10 cm beside where it was taken, and in a third
world a toast comes first: who does the new way, and the old one when both are shown again? Writes
scores, a figure and a tensorboard log into `runs/changing_world/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pacnet.forward_models.kinematics import KinematicModel
from pacnet.kernels.threads import use_one_thread
from train.changing.replicates import DRINK, GAIN, run_replicates
from train.changing.report import draw_gain, print_drink, print_gain
from train.common.replication import add_arguments, print_places, record_replicates, seeds_of
from train.common.runs import make_parser, run_folder
from train.postural.alone.learning import load_body


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.changing_world", __doc__, episodes=5)
    add_arguments(parser, replicates=2)
    return parser.parse_args()


def main() -> None:
    """Load the body, make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    body = load_body(arguments.body)
    with run_folder("changing_world", arguments.seed, arguments.runs) as folder:
        run(arguments, body, folder)


def run(arguments: argparse.Namespace, body: KinematicModel, folder: Path) -> None:
    """Run every replicate; write their scores, means and a figure."""
    use_one_thread()
    replicates = run_replicates(seeds_of(arguments), arguments.episodes, body)
    scores = record_replicates(
        "train.changing_world",
        arguments,
        folder,
        replicates,
        lambda scores: {"changing_world": draw_gain(scores[GAIN])},
    )
    print_gain(scores[GAIN])
    print_drink(scores[DRINK])
    print_places(folder)


if __name__ == "__main__":
    main()
