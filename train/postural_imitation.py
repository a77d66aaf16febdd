"""Experiment 1: an imitator learns to drink a glass of beer by watching, then does it itself.

Records noisy demonstrations as a LeRobot dataset, learns from the dataset, writes a checkpoint,
loads it, recalls on new episodes, and writes scores, figures, a video and a tensorboard log into
`runs/postural_imitation/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from envs.humanoid import JOINTS
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Recorder
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
from train.postural.episodes import (
    TASK,
    Condition,
    demonstration_seeds,
    make_environment,
    motor_targets,
    recall_episodes,
    recall_seeds,
    watch_demonstration,
)
from train.postural.report import FPS, draw, film, print_table
from train.postural.scores import score_episodes, score_order, winners_of

FEATURES = {
    "observation.state": STATE_NAMES,  # perceived angles and velocities of the demonstrator
    "observation.environment_state": GLASS_NAMES,  # its glass, in its body frame
    "action": JOINTS,  # joint-angle targets
}
# Velocities [rad/s] weigh a third of angles [rad] and of the glass [m, rad]: their noise is larger.
SCALE = (1.0,) * len(JOINTS) + (1 / 3,) * len(JOINTS) + (1.0,) * len(GLASS_NAMES)
NOVELTY_THRESHOLD = 0.55  # `python -m train.threshold_sweep` shows what others give
WINNER_TAU = 5.0  # [firings] nodes settle in 15 wins: within the first demonstration, most of them
CHUNK = 50  # samples learned between two points of the learning curves


def parse_arguments() -> argparse.Namespace:
    """The command line."""
    parser = make_parser("train.postural_imitation", __doc__, episodes=100)
    parser.add_argument(
        "--demonstrations", type=positive, default=8, help="noisy demonstrations to learn from"
    )
    parser.add_argument(
        "--novelty-threshold",
        type=threshold,
        default=NOVELTY_THRESHOLD,
        help="activation under which a percept is novel; a higher one makes more nodes",
    )
    parser.add_argument(
        "--recall-by",
        choices=("cue", "order"),
        default="cue",
        help="a node's target whose cue is nearest to the percept, or, as in the paper, the next",
    )
    return parser.parse_args()


def record(folder: Path, seed: int, count: int, behaviour: str = "drink", task: str = TASK) -> None:
    """Records demonstrations, as a resting imitator perceives them, into a LeRobot dataset.

    Args:
        folder: of the dataset, which is made, or appended to.
        seed: of the demonstrations.
        count: how many.
        behaviour: that is demonstrated, of `envs.behaviours.BEHAVIOURS`.
        task: the same in words.
    """
    environment = make_environment(Condition(behaviour=behaviour))
    with Recorder(folder, FPS, FEATURES, "postural_imitation") as recorder:
        for episode_seed in tqdm(demonstration_seeds(seed, count), "recording", unit="episode"):
            percepts = watch_demonstration(environment, episode_seed)
            recorder.save_episode(task, frames_of(percepts))


def frames_of(percepts: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """The features of a watched demonstration `[T, 28]`, as they are recorded."""
    state, glass = np.split(percepts, [len(STATE_NAMES)], axis=1)
    return {
        "observation.state": state,
        "observation.environment_state": glass,
        "action": motor_targets(percepts),
    }


def attention_config(novelty_threshold: float = NOVELTY_THRESHOLD) -> SOFMConfig:
    """The map's settings for percepts of a demonstrator and its glass."""
    return SOFMConfig.paper(
        len(SCALE), scale=SCALE, novelty_threshold=novelty_threshold, winner_tau=WINNER_TAU
    )


def make_network(novelty_threshold: float, recall_by: Literal["cue", "order"] = "cue") -> PACNet:
    """An from_demonstrations network for this experiment: one schema per node, as in the paper."""
    schemas = MotorSchemasConfig(len(JOINTS), len(SCALE), recall_by)
    return PACNet(PACNetConfig(attention_config(novelty_threshold), schemas))


def learn(network: PACNet, demonstrations: Demonstrations, log: LearningLog | None = None) -> None:
    """The learning phase: watches each demonstration once, in order."""
    total = sum(len(demonstration.state) for demonstration in demonstrations)
    with tqdm(total=total, desc="learning", unit="sample") as progress:
        for demonstration in demonstrations:
            percepts = demonstration.percepts.split(CHUNK)
            for seen, done in zip(percepts, demonstration.action.split(CHUNK), strict=True):
                observed = network.observe(seen, done, demonstration.episode, demonstration.task)
                if log is not None:
                    log.observed(network.sofm, observed)
                progress.update(len(seen))


def main() -> None:
    """Record, learn, recall, show."""
    arguments = parse_arguments()
    with run_folder("postural_imitation", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """One run, from demonstrations to scores."""
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
        for picture in (*sorted((folder / "figures").iterdir()), folder / "recall.gif"):
            log.picture(picture.stem, picture)

    print_table(scores)
    print(f"\nscores    {folder / 'metrics.json'}")
    print(f"figures   {folder / 'figures'}")
    print(f"video     {folder / 'recall.mp4'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()
