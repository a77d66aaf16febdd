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
from train.common.learning_log import LearningLog
from train.common.runs import (
    command_line,
    make_parser,
    positive,
    run_folder,
    save_figures,
    write_metrics,
)
from train.common.summary import Summary, summarise
from train.postural.alone.learning import load_body


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.changing_world", __doc__, episodes=5)
    parser.add_argument(
        "--replicates",
        type=positive,
        default=2,
        help="repetitions; each learns everything anew from the next seed",
    )
    parser.add_argument(
        "--body", default="checkpoints/body", help="folder of the body model, from train.babbling"
    )
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
    seeds = range(arguments.seed, arguments.seed + arguments.replicates)
    command = command_line("train.changing_world", arguments)
    done, scores = [], dict[str, dict[str, Summary]]()
    for replicate in run_replicates(seeds, arguments.episodes, body):
        done.append(replicate)
        scores = {name: summarise([one[name] for one in done]) for name in (GAIN, DRINK)}
        # After each replicate, so that none is lost.
        write_metrics(folder / "metrics.json", command, arguments.seed, scores)
    save_figures(folder / "figures", {"changing_world": draw_gain(scores[GAIN])})
    with LearningLog(folder / "tensorboard") as log:
        for name, values in scores.items():
            log.scores({cell: score["mean"] for cell, score in values.items()}, name)
        log.pictures(folder / "figures" / "changing_world.png")
    print_gain(scores[GAIN])
    print_drink(scores[DRINK])
    print(f"\nscores    {folder / 'metrics.json'}\nfigure    {folder / 'figures'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()
