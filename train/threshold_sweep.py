"""Learn Experiment 1 with different novelty thresholds, and compare nodes and task success.

A threshold that is too low makes too few nodes (over-generalisation), one that is too high makes
too many (over-fitting); see the paper's section "The Integrated System". Writes the scores and a
figure into `runs/threshold_sweep/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Literal

from matplotlib.figure import Figure

from pacnet.datasets.demonstrations import load_demonstrations
from train.common.learning_log import LearningLog
from train.common.runs import (
    command_line,
    make_parser,
    positive,
    run_folder,
    save_figures,
    write_metrics,
)
from train.postural.episodes import Condition, recall_episodes, recall_seeds
from train.postural.figures import threshold_sweep
from train.postural.learning import NOVELTY_THRESHOLD, learn, make_network, record
from train.postural.scores import score_episodes

THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
WAYS: tuple[Literal["cue", "order"], ...] = ("cue", "order")  # of recall
SHOWN = ("novelty_threshold", "recall_by", "nodes", "task_success_rate", "wrist_distance_mean_m")


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.threshold_sweep", __doc__, episodes=20)
    parser.add_argument(
        "--demonstrations", type=positive, default=8, help="noisy demonstrations to learn from"
    )
    return parser.parse_args()


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("threshold_sweep", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Learn the same demonstrations and recall the same episodes with every threshold."""
    record(folder / "dataset", arguments.seed, arguments.demonstrations)
    demonstrations = load_demonstrations(folder / "dataset")
    seeds = recall_seeds(arguments.seed, arguments.episodes)
    sweep: list[dict[str, float | str]] = []
    for threshold in THRESHOLDS:
        taught = make_network(threshold)
        with LearningLog(folder / "tensorboard" / f"threshold-{threshold}") as log:
            learn(taught, demonstrations, log)
        for recall_by in WAYS:  # does not affect learning
            network = make_network(threshold, recall_by)
            network.load_state_dict(taught.state_dict())
            checkpoint = folder / f"checkpoint-{threshold}-{recall_by}"
            network.save_pretrained(checkpoint)
            label = f"threshold {threshold}, by {recall_by}"
            scores = score_episodes(recall_episodes(checkpoint, seeds, Condition(), label))
            settings = {"novelty_threshold": threshold, "recall_by": recall_by}
            sweep.append({**settings, "nodes": len(network.sofm), **scores})
    command = command_line("train.threshold_sweep", arguments)
    write_metrics(folder / "metrics.json", command, arguments.seed, {"sweep": sweep})
    save_figures(folder, {"threshold_sweep": draw(sweep)})
    print("\n" + "".join(f"{name:>24}" for name in SHOWN))
    for scores in sweep:
        print("".join(f"{_short(scores[name]):>24}" for name in SHOWN))
    print(f"\nscores    {folder / 'metrics.json'}\nfigure    {folder / 'threshold_sweep.png'}")


def draw(sweep: list[dict[str, float | str]]) -> Figure:
    """Draw nodes, and success by each way to recall, over the threshold."""
    ways = {way: [scores for scores in sweep if scores["recall_by"] == way] for way in WAYS}
    nodes = [scores["nodes"] for scores in ways["cue"]]
    success = {f"by {way}": [s["task_success_rate"] for s in ways[way]] for way in WAYS}
    return threshold_sweep(THRESHOLDS, nodes, success, NOVELTY_THRESHOLD)


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


if __name__ == "__main__":
    main()
