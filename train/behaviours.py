"""Learn several behaviours with one network, which then imitates and recognizes each of them.

The imitator watches demonstrations of two behaviours that begin alike: a drink, and a toast
followed by a drink. Nodes with different continuations keep several motor schemas, which compete.
New episodes of both are then imitated and recognized. A third behaviour that was not taught, moving
the glass, should be flagged as novel. The baseline is a network with one schema per node that each
new episode overwrites, as in the paper. Writes the dataset, checkpoints, scores, figures, a video
and a tensorboard log into `runs/behaviours/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from envs.humanoid import JOINTS
from envs.physics import CONTROL_TIMESTEP
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import CompetingSchemasConfig, PACNet, PACNetConfig, RecognitionConfig
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.evaluation.recognition_figures import recognition_over_time
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
from train.postural.behaviours.episodes import (
    CHECKPOINTS,
    ONE,
    SEVERAL,
    TASKS,
    BehaviourEpisode,
    behaviour_episodes,
)
from train.postural.behaviours.figures import naming, novelty
from train.postural.behaviours.scores import (
    NAMING_SHARE,
    score_novelty,
    score_recall,
    score_recognition,
)
from train.postural.episodes import (
    FPS,
    Condition,
    demonstration_seeds,
    make_environment,
    recall_seeds,
    watch_demonstration,
)
from train.postural.learning import (
    FEATURES,
    NOVELTY_THRESHOLD,
    SCALE,
    attention_config,
    frames_of,
    learn,
    make_network,
)
from train.postural.report import film

TAUGHT, NEW = ("drink", "toast"), "move"
FILMED = list(TASKS).index("toast")  # index of its first episode
NOVEL_ABOVE = 0.19  # chosen on seeds 1000 to 1239


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.behaviours", __doc__)
    parser.add_argument(
        "--episodes", type=positive, default=100, help="new episodes of each behaviour"
    )
    parser.add_argument(
        "--demonstrations",
        type=positive,
        default=8,
        help="noisy demonstrations of each taught behaviour",
    )
    return parser.parse_args()


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("behaviours", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Record, learn, recall, recognize, score and draw."""
    use_one_thread()
    record(folder / "dataset", arguments.seed, arguments.demonstrations)
    demonstrations = load_demonstrations(folder / "dataset")
    with LearningLog(folder / "tensorboard") as log:
        networks = {SEVERAL: make_competing_network(), ONE: make_network(NOVELTY_THRESHOLD)}
        for system, network in networks.items():
            learn(network, demonstrations, log if system == SEVERAL else None)
            network.save_pretrained(folder / CHECKPOINTS[system])

        seeds = recall_seeds(arguments.seed, len(TASKS) * arguments.episodes)
        episodes = behaviour_episodes(folder, list(zip(_in_turn(len(seeds)), seeds, strict=True)))
        scores = score(episodes, networks[SEVERAL])
        command = command_line("train.behaviours", arguments)
        write_metrics(folder / "metrics.json", command, arguments.seed, scores)
        save_figures(folder / "figures", draw(episodes))
        film(folder / CHECKPOINTS[SEVERAL], seeds[FILMED], Condition(behaviour="toast"), folder)

        log.scores(scores["recognition"], "recognition")
        log.scores(scores["novelty"], "novelty")
        log.projector(networks[SEVERAL].sofm, (*STATE_NAMES, *GLASS_NAMES))
        log.pictures(*sorted((folder / "figures").iterdir()), folder / "recall.gif")
    print_table(scores)
    print(f"\nscores    {folder / 'metrics.json'}\nfigures   {folder / 'figures'}")
    print(f"video     {folder / 'recall.mp4'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")
    print(f"to watch  python -m train.recognise {folder / 'checkpoint'} DATASET")


def record(folder: Path, seed: int, count: int) -> None:
    """Record demonstrations of the taught behaviours, alternating, into a LeRobot dataset."""
    environments = {name: make_environment(Condition(behaviour=name)) for name in TAUGHT}
    seeds = demonstration_seeds(seed, len(TAUGHT) * count)
    with Recorder(folder, FPS, FEATURES, "behaviours") as recorder:
        for place, episode_seed in enumerate(tqdm(seeds, "recording", unit="episode")):
            behaviour = TAUGHT[place % len(TAUGHT)]
            percepts = watch_demonstration(environments[behaviour], episode_seed)
            recorder.save_episode(TASKS[behaviour], frames_of(percepts))


def make_competing_network() -> PACNet:
    """Return an untrained network whose nodes keep several schemas."""
    recognition = RecognitionConfig(novel_above=NOVEL_ABOVE)
    schemas = CompetingSchemasConfig(len(JOINTS), len(SCALE), recognition=recognition)
    return PACNet(PACNetConfig(attention_config(), schemas))


def score(episodes: Sequence[BehaviourEpisode], network: PACNet) -> dict[str, Any]:
    """Return all that `metrics.json` holds."""
    known = [episode for episode in episodes if episode.behaviour in TAUGHT]
    new = [episode for episode in episodes if episode.behaviour == NEW]
    return {
        "nodes": len(network.sofm),
        "schemas": len(network.schemas.lengths),
        "targets": int(network.schemas.lengths.sum()),
        "recall": score_recall(known, TAUGHT),
        "recognition": score_recognition(known, TAUGHT),
        "novelty": score_novelty(known, new),
    }


def draw(episodes: Sequence[BehaviourEpisode]) -> dict[str, Figure]:
    """Draw when behaviours are named, how novel the new one is, and an episode of each."""
    known = {name: [e for e in episodes if e.behaviour == name] for name in TAUGHT}
    probabilities = {
        name: [e.recognition.probability[:, place].numpy() for e in some]
        for place, (name, some) in enumerate(known.items())
    }
    partings = {name: [e.parting for e in some] for name, some in known.items()}
    everyone = [episode for some in known.values() for episode in some]
    new = [e for e in episodes if e.behaviour == NEW]
    lengths = [NAMING_SHARE * len(e.shown.phases) * CONTROL_TIMESTEP for e in everyone]
    later = [
        np.concatenate([e.recognition.novelty.numpy()[e.approached :] for e in some])
        for some in (everyone, new)
    ]
    figures = {
        "naming": naming(probabilities, partings, lengths, CONTROL_TIMESTEP),
        "novelty": novelty(*later, NOVEL_ABOVE, (" and ".join(TAUGHT), f"{NEW}, never taught")),
    }
    for name in TASKS:
        first = next(e for e in episodes if e.behaviour == name)
        title = f"Watching: {TASKS[name]}"
        figures[f"recognised_{name}"] = recognition_over_time(
            first.recognition, TAUGHT, NOVEL_ABOVE, CONTROL_TIMESTEP, title
        )
    return figures


def print_table(scores: Mapping[str, Any]) -> None:
    """Print the scores."""
    head = ("completed", "wrist mean", "wrist max", "at parting")
    print(f"\n{'':34}{'shown':>8}" + "".join(f"{name:>12}" for name in head))
    for system, by_behaviour in scores["recall"].items():
        for behaviour, values in by_behaviour.items():
            print(
                f"{system:34}{behaviour:>8}{values['task_success_rate']:>12.3f}"
                f"{values['wrist_distance_mean_m']:>10.4f} m"
                f"{values['wrist_distance_max_m']:>10.4f} m"
                f"{values['wrist_distance_at_parting_m']:>10.4f} m"
            )
    for group in ("recognition", "novelty"):
        print()
        for name, value in scores[group].items():
            print(f"{group + '/' + name:56}{value:>10.4g}")


def _in_turn(count: int) -> list[str]:
    return [list(TASKS)[place % len(TASKS)] for place in range(count)]


if __name__ == "__main__":
    main()
