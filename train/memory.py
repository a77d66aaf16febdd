"""Compare what is worth remembering where memory is bounded.

The frames that an `Imitator` with a budget keeps are compared with those that maps, a reservoir,
k-means and every n-th frame keep: who acts alone on them, and how far off is the target of the
nearest? Drinks are shown plainly, with a minute of rest before each, with one toast among twenty,
and with three times the noise; walls are followed by a teacher that stops for a minute now and
then. Writes scores, a figure and a tensorboard log into `runs/memory/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pacnet.forward_models.kinematics import KinematicModel
from pacnet.kernels.threads import use_one_thread
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
from train.remembering.replicates import ALONE, CUES, EXPERIMENTS, run_replicates
from train.remembering.report import draw, print_tables


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.memory", __doc__, episodes=5)
    parser.add_argument(
        "--replicates",
        type=positive,
        default=1,
        help="repetitions; each learns everything anew from the next seed",
    )
    parser.add_argument(
        "--body", default="checkpoints/body", help="folder of the body model, from train.babbling"
    )
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
    seeds = range(arguments.seed, arguments.seed + arguments.replicates)
    command = command_line("train.memory", arguments)
    done, scores = [], dict[str, dict[str, Summary]]()
    chosen = EXPERIMENTS if arguments.only is None else (arguments.only,)
    for replicate in run_replicates(seeds, arguments.episodes, body, chosen):
        done.append(replicate)
        scores = {name: summarise([one[name] for one in done]) for name in replicate}
        # After each replicate, so that none is lost.
        write_metrics(folder / "metrics.json", command, arguments.seed, scores)
    figures = {"memory": draw(scores)} if {ALONE, CUES} <= scores.keys() else {}
    save_figures(folder / "figures", figures)
    with LearningLog(folder / "tensorboard") as log:
        for name, values in scores.items():
            log.scores({cell: score["mean"] for cell, score in values.items()}, name)
        log.pictures(*(folder / "figures" / f"{name}.png" for name in figures))
    print_tables(scores)
    print(f"\nscores    {folder / 'metrics.json'}\nfigure    {folder / 'figures'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()
