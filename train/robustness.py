"""Recall a checkpoint of Experiment 1 at other paces and noise levels than in training.

Writes the scores of every condition and a figure into `runs/robustness/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from train.common.runs import (
    command_line,
    load_or_exit,
    make_parser,
    run_folder,
    save_figures,
    write_metrics,
)
from train.postural.episodes import PERCEPTS, TARGETS, Condition, recall_episodes, recall_seeds
from train.postural.figures import robustness
from train.postural.scores import Scores, score_episodes

CONDITIONS = {
    "as taught": Condition(),
    "25 % faster": Condition(pace=1.25),
    "25 % slower": Condition(pace=0.75),
    "noise x 2": Condition(noise=2.0),
    "noise x 4": Condition(noise=4.0),
}
SHOWN = ("task_success_rate", "wrist_distance_mean_m", "wrist_distance_max_m", "commanded_share")


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.robustness", __doc__, episodes=100)
    parser.add_argument(
        "checkpoint",
        nargs="?",
        default="checkpoints/postural_imitation",
        help="folder of a trained network",
    )
    return parser.parse_args()


def main() -> None:
    """Check the checkpoint and run the experiment."""
    arguments = parse_arguments()
    load_or_exit(arguments.checkpoint, PERCEPTS, TARGETS)
    with run_folder("robustness", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Recall the same episodes, by their seeds, under every condition."""
    seeds = recall_seeds(arguments.seed, arguments.episodes)
    scores: dict[str, Scores] = {}
    for name, condition in CONDITIONS.items():
        scores[name] = score_episodes(recall_episodes(arguments.checkpoint, seeds, condition, name))
    command = command_line("train.robustness", arguments)
    write_metrics(folder / "metrics.json", command, arguments.seed, {"conditions": scores})
    figure = robustness(
        list(scores),
        [score["task_success_rate"] for score in scores.values()],
        [score["wrist_distance_mean_m"] for score in scores.values()],
    )
    save_figures(folder, {"robustness": figure})
    print(f"\n{'':14}" + "".join(f"{name:>24}" for name in SHOWN))
    for name, score in scores.items():
        print(f"{name:14}" + "".join(f"{score[key]:24.4f}" for key in SHOWN))
    print(f"\nscores    {folder / 'metrics.json'}\nfigure    {folder / 'robustness.png'}")


if __name__ == "__main__":
    main()
