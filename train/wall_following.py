"""Run Experiment 2: a robot learns to follow walls by following a teacher, then acts alone.

The robot wanders to fit a forward model, and follows a teacher along left and right walls. Both are
recorded as LeRobot datasets and learned; the checkpoints are saved and loaded. The robot then acts
alone: once for a long time, and once under each of several conditions that show what causes the
behaviour. Scores, figures, a video and a tensorboard log go into
`runs/wall_following/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

from envs.khepera import INFRARED_NAMES
from pacnet import MLPForwardModel, PACNet
from pacnet.kernels.threads import use_one_thread
from train.common.learning_log import LearningLog
from train.common.runs import (
    command_line,
    make_parser,
    positive,
    run_folder,
    save_figures,
    taught_arena,
    write_metrics,
)
from train.common.summary import summarise
from train.walls.conditions import STEPS, Scores, replicates, run_conditions
from train.walls.drivers import Recalling
from train.walls.episodes import Place, act_alone, alone_seed
from train.walls.forward_model import fit, make_forward_model, walks_of
from train.walls.learning import (
    TRANSITIONS,
    load_episodes,
    load_wandering,
    make_network,
    record_following,
    record_wandering,
    teach,
)
from train.walls.report import draw, draw_conditions, film, print_conditions, print_typical
from train.walls.scores import cluster_agreement, name_clusters, score_run
from train.walls.variants import Learned

# In a clone.
SHIPPED = Path(__file__).parents[1] / "checkpoints" / "wall_following" / "metrics.json"


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.wall_following", __doc__)
    parser.add_argument(
        "--arena",
        type=taught_arena,
        default="paper",
        help="arena to learn in: paper, or the seed of a random one",
    )
    parser.add_argument(
        "--steps",
        type=positive,
        default=30_000,
        help="length of the long run alone, in steps of 0.1 s",
    )
    parser.add_argument(
        "--replicates",
        type=positive,
        default=1,
        help="repetitions of the conditions; each learns everything anew from the next seed",
    )
    parser.add_argument(
        "--condition-steps",
        type=positive,
        default=STEPS,
        help="length of the run under each condition",
    )
    return parser.parse_args()


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("wall_following", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Learn, act alone, compare conditions, score, draw and film."""
    use_one_thread()
    with LearningLog(folder / "tensorboard") as log:
        learned = learn(arguments.seed, arguments.arena, folder, log)
        network = learned.network
        recalled = _act_alone(learned, arguments.steps)

        figures, scores = draw(network, learned.episodes, recalled, arguments.arena)
        scores |= score_run(recalled)
        names = name_clusters(network.sofm.prototypes.numpy())
        scores["cluster_agreement"] = cluster_agreement(recalled, names)
        save_figures(folder / "figures", figures)
        film(network, arguments.arena, arguments.seed, folder)

        command = command_line("train.wall_following", arguments)
        summary = {}
        for summary in _compare(learned, arguments):  # after each replicate, so that none is lost
            document = {**scores, "conditions": summary}
            write_metrics(folder / "metrics.json", command, arguments.seed, document)
        save_figures(folder / "figures", {"conditions": draw_conditions(summary)})

        log.scores(scores)
        log.projector(network.sofm, INFRARED_NAMES)
        log.pictures(*sorted((folder / "figures").iterdir()), folder / "recall.gif")
    _print(folder, scores, summary)


def learn(seed: int, where: str | int, folder: Path, log: LearningLog) -> Learned:
    """Record, learn from the records, save, and load what was saved."""
    record_wandering(folder / "wandering", where, seed, TRANSITIONS)
    wandering = load_wandering(folder / "wandering")
    record_following(folder / "dataset", where, seed)
    episodes = load_episodes(folder / "dataset")
    model = make_forward_model(seed)
    _, losses = fit(model, walks_of(wandering, episodes), seed)
    log.losses(losses.tolist())
    model.save_pretrained(folder / "forward_model")

    network = make_network(model)
    teach(network, episodes, log)
    network.save_pretrained(folder / "checkpoint")

    model = MLPForwardModel.from_pretrained(folder / "forward_model")
    network = PACNet.from_pretrained(folder / "checkpoint", model).eval()
    return Learned(seed, where, wandering, episodes, network)


def _act_alone(learned: Learned, steps: int) -> Any:
    """Let the robot act alone for a long time."""
    with tqdm(total=steps, desc="alone", unit="step") as progress:
        return act_alone(
            Recalling(learned.network, learned.seed),
            Place(learned.arena),
            alone_seed(learned.seed),
            steps,
            lambda _: progress.update(),
        )


def _compare(learned: Learned, arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield the scores of all conditions over the replicates so far; this run is the first."""
    done = [run_conditions(learned, arguments.condition_steps)]
    yield _summary(done)
    others = range(arguments.seed + 1, arguments.seed + arguments.replicates)
    for scores in replicates(others, arguments.arena, arguments.condition_steps):
        done.append(scores)
        yield _summary(done)


def _summary(done: list[dict[str, Scores]]) -> dict[str, Any]:
    return {name: summarise([scores[name] for scores in done]) for name in done[0]}


def _print(folder: Path, scores: dict[str, Any], summary: dict[str, Any]) -> None:
    for name, value in scores.items():
        print(f"{name:32}{value:>12.4f}" if isinstance(value, float) else f"{name:32}{value:>12}")
    print_conditions(summary)
    print_typical(SHIPPED)
    print(f"\nscores         {folder / 'metrics.json'}")
    print(f"figures        {folder / 'figures'}")
    print(f"video          {folder / 'recall.mp4'}")
    print(f"network        {folder / 'checkpoint'}")
    print(f"forward model  {folder / 'forward_model'}")
    print(f"to browse      tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()
