"""Recall a checkpoint of Experiment 1 on new episodes, without training, and score it.

Writes scores and a video into `runs/recall/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from train.common.runs import (
    command_line,
    factor,
    load_or_exit,
    make_parser,
    run_folder,
    write_metrics,
)
from train.postural.episodes import PERCEPTS, TARGETS, Condition, recall_episodes, recall_seeds
from train.postural.report import film, print_table
from train.postural.scores import score_episodes


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.recall", __doc__, episodes=20)
    parser.add_argument("checkpoint", help="folder, such as checkpoints/postural_imitation")
    parser.add_argument(
        "--pace",
        type=factor,
        default=1.0,
        help="of the demonstrator; 1.25 is 25 %% faster than in training",
    )
    parser.add_argument("--noise", type=factor, default=1.0, help="factor on the perceptual noise")
    return parser.parse_args()


def main() -> None:
    """Load the checkpoint and recall it."""
    arguments = parse_arguments()
    network = load_or_exit(arguments.checkpoint, PERCEPTS, TARGETS)
    with run_folder("recall", arguments.seed, arguments.runs) as folder:
        run(arguments, len(network.sofm), folder)


def run(arguments: argparse.Namespace, nodes: int, folder: Path) -> None:
    """Recall episodes of one condition; write their scores and a video of the first."""
    condition = Condition(arguments.pace, arguments.noise)
    seeds = recall_seeds(arguments.seed, arguments.episodes)
    episodes = recall_episodes(arguments.checkpoint, seeds, condition)
    scores = {"nodes": nodes} | score_episodes(episodes)
    command = command_line("train.recall", arguments)
    write_metrics(folder / "metrics.json", command, arguments.seed, scores)
    film(arguments.checkpoint, seeds[0], condition, folder)
    print_table(scores)
    print(f"\nscores    {folder / 'metrics.json'}\nvideo     {folder / 'recall.mp4'}")


if __name__ == "__main__":
    main()
