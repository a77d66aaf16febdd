"""Learn from demonstrations of which some are spoiled, and measure what a spoiled one destroys.

Compares two ways of learning: overwriting a motor schema by each new episode, as in the paper, and
several competing schemas per node, which are replaced only by ones of no lower quality. Each
replicate has its own demonstrations of a drink; in some of them the hand trembles, is interrupted
or misses the glass. They are learned in random order, where a later good demonstration can repair
the damage, and with the spoiled ones last. Writes datasets, checkpoints, scores, a figure and a
tensorboard log into `runs/retraining/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import PACNet
from train.common.learning_log import LearningLog
from train.common.runs import (
    command_line,
    make_parser,
    positive,
    run_folder,
    save_figures,
    threshold,
    write_metrics,
)
from train.postural.retraining.replicates import draw_replicates, run_replicates
from train.postural.retraining.report import Outcome, draw, print_tables, summary


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.retraining", __doc__, episodes=10)
    parser.add_argument(
        "--replicates",
        type=positive,
        default=10,
        help="repetitions, each with its own demonstrations",
    )
    parser.add_argument(
        "--demonstrations", type=positive, default=10, help="in each replicate, two or more"
    )
    parser.add_argument(
        "--spoiled",
        type=threshold,
        default=0.2,
        help="share of the demonstrations with a mishap; at least one, but not all",
    )
    arguments = parser.parse_args()
    if arguments.demonstrations < 2:
        parser.error("argument --demonstrations: expected an integer ≥ 2, got '1'")
    return arguments


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("retraining", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Run every replicate; write their scores and means."""
    replicates = draw_replicates(
        arguments.seed, arguments.replicates, arguments.demonstrations, arguments.spoiled
    )
    command = command_line("train.retraining", arguments)
    outcomes: list[Outcome] = []
    scores = {}
    for by_policy in run_replicates(replicates, folder, arguments.episodes):
        outcomes.append(Outcome(replicates[len(outcomes)], by_policy))
        scores = summary(outcomes)  # after each replicate, so that none is lost
        write_metrics(folder / "metrics.json", command, arguments.seed, scores)
    save_figures(folder / "figures", {"retraining": draw(outcomes)})
    network = PACNet.from_pretrained(folder / "checkpoint" / "replicate-0" / "several_schemas")
    with LearningLog(folder / "tensorboard") as log:
        for policy, values in scores["policies"].items():
            log.scores({name: score["mean"] for name, score in values.items()}, policy)
        log.projector(network.sofm, (*STATE_NAMES, *GLASS_NAMES))
        log.pictures(folder / "figures" / "retraining.png")
    print_tables(scores)
    print(f"\nscores    {folder / 'metrics.json'}\nfigure    {folder / 'figures'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()
