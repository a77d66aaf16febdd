"""Run Experiment 1: drinking a glass of beer is watched, then done, with nobody to copy as well.

Records noisy demonstrations as a LeRobot dataset. Two learners learn from it, and are saved and
loaded: PACNet, which watches a demonstrator while it imitates, and imitators with a body model,
which are alone with their own glass. Both act beside simpler rules, where the glass was shown and
elsewhere. Scores, figures, videos and a tensorboard log go into
`runs/postural_imitation/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import PACNet
from pacnet.forward_models.kinematics import KinematicModel
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
from train.common.summary import Summary
from train.common.typical import load_typical
from train.postural.alone.drawing import draw as draw_alone
from train.postural.alone.drawing import furthest
from train.postural.alone.film import film as film_alone
from train.postural.alone.learning import load_body
from train.postural.alone.replicates import record_and_learn, run_replicate, summary_of
from train.postural.alone.report import print_tables
from train.postural.episodes import Condition, recall_episodes, recall_seeds
from train.postural.learning import NOVELTY_THRESHOLD, make_network
from train.postural.report import draw, film, print_table
from train.postural.scores import Scores, score_episodes, score_order, winners_of

TYPICAL = "checkpoints/postural_imitation/alone.json"  # what is printed beside one replicate


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.postural_imitation", __doc__, episodes=10)
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
    parser.add_argument(
        "--body", default="checkpoints/body", help="folder of the body model, from train.babbling"
    )
    parser.add_argument(
        "--replicates",
        type=positive,
        default=1,
        help="repetitions of what is alone; each learns everything anew from the next seed",
    )
    return parser.parse_args()


def main() -> None:
    """Load the body, make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    body = load_body(arguments.body)
    with run_folder("postural_imitation", arguments.seed, arguments.runs) as folder:
        run(arguments, body, folder)


def run(arguments: argparse.Namespace, body: KinematicModel, folder: Path) -> None:
    """Record, learn, watch and imitate, act alone, score, draw and film."""
    use_one_thread()
    with LearningLog(folder / "tensorboard") as log:
        scores = imitate(arguments, folder, log)
        command = command_line("train.postural_imitation", arguments)
        summary = {}
        for summary in act_alone(arguments, body, folder):  # after each replicate: none is lost
            document = {**scores, "alone": summary}
            write_metrics(folder / "metrics.json", command, arguments.seed, document)
        log.scores(scores)
        log.projector(
            PACNet.from_pretrained(folder / "checkpoint").sofm, (*STATE_NAMES, *GLASS_NAMES)
        )
        log.pictures(*sorted((folder / "figures").iterdir()), *sorted(folder.glob("*.gif")))
    print_table(scores)
    several = arguments.replicates > 1  # which show their own spread
    print_tables(summary, None if several else load_typical(TYPICAL, "alone"))
    print(f"\nscores    {folder / 'metrics.json'}")
    print(f"figures   {folder / 'figures'}")
    print(f"videos    {folder / 'recall.mp4'}, {folder / 'alone.mp4'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")


def imitate(arguments: argparse.Namespace, folder: Path, log: LearningLog) -> Scores:
    """Let PACNet learn, and recall while it watches; draw the paper's figures and film it."""
    network = make_network(arguments.novelty_threshold, arguments.recall_by)
    shown = record_and_learn(folder, arguments.seed, arguments.demonstrations, network, log)

    network = PACNet.from_pretrained(folder / "checkpoint").eval()
    seeds = recall_seeds(arguments.seed, arguments.episodes)
    episodes = recall_episodes(folder / "checkpoint", seeds, Condition())
    figures, scores = draw(network, shown, episodes[0])
    demonstrated = winners_of(network, shown.episodes[-1].percepts.numpy())
    scores |= score_episodes(episodes)
    scores["winner_order_agreement"] = score_order(episodes, demonstrated)
    save_figures(folder / "figures", figures)
    film(folder / "checkpoint", seeds[0], Condition(), folder)
    return scores


def act_alone(
    arguments: argparse.Namespace, body: KinematicModel, folder: Path
) -> Iterator[dict[str, dict[str, Summary]]]:
    """Yield the scores of those who act alone, over the replicates so far.

    The first replicate is that of PACNet's demonstrations, and is drawn and filmed.
    """
    trials, scores = run_replicate(folder, body, arguments.seed, arguments.episodes)
    yield summary_of(replicates := [scores])
    network = PACNet.from_pretrained(folder / "checkpoint").eval()
    save_figures(folder / "figures", draw_alone(network, trials))
    film_alone(folder, furthest(trials).seed)
    for seed in range(arguments.seed + 1, arguments.seed + arguments.replicates):
        place = folder / f"replicate-seed{seed}"
        network = make_network(arguments.novelty_threshold, arguments.recall_by)
        record_and_learn(place, seed, arguments.demonstrations, network)
        replicates.append(run_replicate(place, body, seed, arguments.episodes)[1])
        yield summary_of(replicates)


if __name__ == "__main__":
    main()
