"""Run Experiment 1: an imitator learns to drink a glass of beer by watching, then imitates.

Records noisy demonstrations as a LeRobot dataset, learns from the dataset, saves and loads a
checkpoint, recalls on new episodes, and writes scores, figures, a video and a tensorboard log into
`runs/postural_imitation/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import PACNet
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.kernels.threads import use_one_thread
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
from train.postural.episodes import Condition, recall_episodes, recall_seeds
from train.postural.learning import NOVELTY_THRESHOLD, learn, make_network, record
from train.postural.report import draw, film, print_table
from train.postural.scores import score_episodes, score_order, winners_of


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.postural_imitation", __doc__, episodes=100)
    parser.add_argument(
        "--demonstrations", type=positive, default=8, help="noisy demonstrations to learn from"
    )
    parser.add_argument(
        "--novelty-threshold",
        type=threshold,
        default=NOVELTY_THRESHOLD,
        help="activation below which a percept is novel; higher values create more nodes",
    )
    parser.add_argument(
        "--recall-by",
        choices=("cue", "order"),
        default="cue",
        help="recall the target whose cue is nearest to the percept, or the next (as in the paper)",
    )
    return parser.parse_args()


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("postural_imitation", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Record, learn, recall, score, draw and film."""
    use_one_thread()
    record(folder / "dataset", arguments.seed, arguments.demonstrations)
    demonstrations = load_demonstrations(folder / "dataset")

    with LearningLog(folder / "tensorboard") as log:
        network = make_network(arguments.novelty_threshold, arguments.recall_by)
        learn(network, demonstrations, log)
        network.save_pretrained(folder / "checkpoint")

        network = PACNet.from_pretrained(folder / "checkpoint").eval()
        seeds = recall_seeds(arguments.seed, arguments.episodes)
        episodes = recall_episodes(folder / "checkpoint", seeds, Condition())

        figures, map_scores = draw(network, demonstrations, episodes[0])
        demonstrated = winners_of(network, demonstrations.episodes[-1].percepts.numpy())
        scores = map_scores | score_episodes(episodes)
        scores["winner_order_agreement"] = score_order(episodes, demonstrated)
        command = command_line("train.postural_imitation", arguments)
        write_metrics(folder / "metrics.json", command, arguments.seed, scores)
        save_figures(folder / "figures", figures)
        film(folder / "checkpoint", seeds[0], Condition(), folder)

        log.scores(scores)
        log.projector(network.sofm, (*STATE_NAMES, *GLASS_NAMES))
        log.pictures(*sorted((folder / "figures").iterdir()), folder / "recall.gif")

    print_table(scores)
    print(f"\nscores    {folder / 'metrics.json'}")
    print(f"figures   {folder / 'figures'}")
    print(f"video     {folder / 'recall.mp4'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()
