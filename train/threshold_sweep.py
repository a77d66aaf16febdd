"""Learns Experiment 1 with one novelty threshold after another, and draws what each costs.

Too low a threshold makes too few nodes (over-generalisation), too high a one too many
(over-fitting): the paper, section "The Integrated System". Writes the scores and a figure into
`runs/threshold_sweep/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pacnet.demonstrations import load_demonstrations
from pacnet.figures import threshold_sweep
from train.postural_episodes import Condition, recall_episodes, recall_seeds
from train.postural_imitation import NOVELTY_THRESHOLD, learn, make_network, record
from train.postural_scores import Scores, score_episodes, score_order, winners_of
from train.runs import (
    command_line,
    make_parser,
    make_run_folder,
    positive,
    save_figures,
    stop_on_interrupt,
    write_metrics,
)

THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)


def parse_arguments() -> argparse.Namespace:
    """The command line."""
    parser = make_parser("train.threshold_sweep", __doc__, episodes=20)
    parser.add_argument(
        "--demonstrations", type=positive, default=5, help="noisy demonstrations to learn from"
    )
    return parser.parse_args()


def main() -> None:
    """Learn and recall with each threshold, then show."""
    arguments = parse_arguments()
    folder = make_run_folder("threshold_sweep", arguments.seed, arguments.runs)
    try:
        run(arguments, folder)
    except KeyboardInterrupt:
        stop_on_interrupt(folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """The same demonstrations and the same recall episodes with every threshold."""
    record(folder / "dataset", arguments.seed, arguments.demonstrations)
    demonstrations = load_demonstrations(folder / "dataset")
    last = demonstrations.episodes[-1].percepts.numpy()
    seeds = recall_seeds(arguments.seed, arguments.episodes)
    sweep: list[Scores] = []
    for threshold in THRESHOLDS:
        network = make_network(threshold)
        learn(network, demonstrations)
        checkpoint = folder / f"checkpoint-{threshold}"
        network.save_pretrained(checkpoint)
        episodes = recall_episodes(checkpoint, seeds, Condition(), f"threshold {threshold}")
        scores = {"novelty_threshold": threshold, "nodes": len(network.sofm)}
        scores |= score_episodes(episodes)
        scores["winner_order_agreement"] = score_order(episodes, winners_of(network, last))
        sweep.append(scores)
    command = command_line("train.threshold_sweep", arguments)
    write_metrics(folder / "metrics.json", command, arguments.seed, {"sweep": sweep})
    columns = ("novelty_threshold", "nodes", "task_success_rate", "wrist_distance_mean_m")
    series = {name: [scores[name] for scores in sweep] for name in columns}
    figure = threshold_sweep(
        THRESHOLDS, series["nodes"], series["task_success_rate"], NOVELTY_THRESHOLD
    )
    save_figures(folder, {"threshold_sweep": figure})
    print("\n" + "".join(f"{name:>24}" for name in columns))
    for scores in sweep:
        print("".join(f"{scores[name]:24.4g}" for name in columns))
    print(f"\nscores    {folder / 'metrics.json'}\nfigure    {folder / 'threshold_sweep.png'}")


if __name__ == "__main__":
    main()
