"""Compare PACNet with the paper's earlier system of 13 hand-made schemas (Figure 2).

Three behaviours are segmented by hand into perceptual-motor pairs: drink 1-2-3-4-5, toast
1-6-7-8-9, move 10-11-12-13. PACNet learns from the same demonstrations, one of each behaviour, and
segments them itself. A third system is a schema network whose schemas are what PACNet's nodes win.
All then imitate new noisy episodes. Writes the demonstrations as a LeRobot
dataset, both checkpoints, scores, figures and a tensorboard log into
`runs/schema_network/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from matplotlib.figure import Figure
from torch import Tensor
from tqdm import tqdm

from envs.physics import CONTROL_TIMESTEP
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES
from pacnet import PACNet
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.kernels.threads import use_one_thread
from pacnet.network.schema_network import SchemaNetwork
from train.common.learning_log import LearningLog
from train.common.runs import command_line, make_parser, run_folder, save_figures, write_metrics
from train.postural.episodes import (
    FPS,
    Condition,
    demonstration_seeds,
    make_environment,
    recall_seeds,
)
from train.postural.learning import (
    FEATURES,
    NOVELTY_THRESHOLD,
    frames_of,
    learn,
    make_network,
)
from train.postural.schema_network.episodes import (
    BY_ATTENTION,
    PACNET,
    SCHEMA_NETWORK,
    SCHEMA_NETWORK_HELD,
    SCHEMAS,
    SYSTEMS,
    Episode,
    Shown,
    held_out_episodes,
    make_schema_network,
    watch,
)
from train.postural.schema_network.figures import (
    Behaviour,
    side_by_side,
    switches_per_episode,
    winners_and_confidences,
)
from train.postural.schema_network.scores import (
    GRASPING,
    score_duplicates,
    score_order,
    score_schemas,
    score_system,
)
from train.postural.schema_network.segments import Division, divide

PASSES = 3  # over the demonstrations: nodes that win rarely need several to habituate


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.schema_network", __doc__, episodes=100)
    return parser.parse_args()


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("schema_network", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Demonstrate, segment by hand, learn, imitate, score and draw."""
    use_one_thread()
    shown = demonstrate(arguments.seed, folder / "dataset")
    schemas = make_schema_network(shown)
    schemas.save_pretrained(folder / "checkpoint" / "schema_network")
    with LearningLog(folder / "tensorboard") as log:
        pacnet = teach(load_demonstrations(folder / "dataset"), log)
        pacnet.save_pretrained(folder / "checkpoint" / "pacnet")
        division = divide(shown, pacnet)
        division.network.save_pretrained(folder / "checkpoint" / "by_attention")

        seeds = deal(recall_seeds(arguments.seed, len(SCHEMAS) * arguments.episodes))
        episodes = held_out_episodes(folder / "checkpoint", seeds)
        scores = score(episodes, schemas, division, pacnet)
        command = command_line("train.schema_network", arguments)
        write_metrics(folder / "metrics.json", command, arguments.seed, scores)
        save_figures(folder / "figures", draw(episodes, schemas, scores))

        for system, by_behaviour in scores["systems"].items():
            for behaviour, values in by_behaviour.items():
                numbers = {name: v for name, v in values.items() if isinstance(v, float)}
                log.scores(numbers, f"{system}/{behaviour}")
        log.projector(pacnet.sofm, (*STATE_NAMES, *GLASS_NAMES))
        log.pictures(*sorted((folder / "figures").iterdir()))
    print_table(scores)
    print(f"\nscores    {folder / 'metrics.json'}\nfigures   {folder / 'figures'}")
    print(f"to browse tensorboard --logdir {folder / 'tensorboard'}")


def deal(seeds: Sequence[int]) -> dict[str, Sequence[int]]:
    """Assign the seeds to the behaviours in turn."""
    return {name: seeds[place :: len(SCHEMAS)] for place, name in enumerate(SCHEMAS)}


def demonstrate(seed: int, dataset: Path) -> dict[str, Shown]:
    """Record one demonstration of each behaviour, watched by a resting imitator."""
    seeds = deal(demonstration_seeds(seed, len(SCHEMAS)))
    shown = {}
    with Recorder(dataset, FPS, FEATURES, "schema_network") as recorder:
        for behaviour in tqdm(SCHEMAS, "recording", unit="episode"):
            shown[behaviour] = watch(
                make_environment(Condition(behaviour=behaviour)), seeds[behaviour][0]
            )
            recorder.save_episode(behaviour, frames_of(shown[behaviour].percepts))
    return shown


def teach(demonstrations: Demonstrations, log: LearningLog) -> PACNet:
    """Return a PACNet that has observed all demonstrations `PASSES` times."""
    network = make_network(NOVELTY_THRESHOLD)
    for pass_index in range(PASSES):
        again = [
            replace(demonstration, episode=pass_index * len(demonstrations) + number)
            for number, demonstration in enumerate(demonstrations)
        ]
        learn(network, replace(demonstrations, episodes=tuple(again)), log)
    return network.eval()


def score(
    episodes: Sequence[Episode], schemas: SchemaNetwork, division: Division, pacnet: PACNet
) -> dict[str, Any]:
    """Return all that `metrics.json` holds."""
    systems: dict[str, dict[str, dict[str, Any]]] = {}
    for system in SYSTEMS:
        systems[system] = {"all": score_system(episodes, system)}
        for behaviour in SCHEMAS:
            some = [episode for episode in episodes if episode.behaviour == behaviour]
            values = score_system(some, system)
            if system in (SCHEMA_NETWORK, SCHEMA_NETWORK_HELD):
                values |= score_schemas(some, system)
            elif system == BY_ATTENTION:
                values |= score_order(some, system, division.orders[behaviour])
            systems[system][behaviour] = values
    nodes = [pacnet.schemas.targets(node) for node in range(len(pacnet.sofm))]
    return {
        "demonstrations_per_behaviour": 1,
        "lessons_of_pacnet": PASSES,
        "episodes_per_behaviour": len(episodes) // len(SCHEMAS),
        "duplicates": {
            SCHEMA_NETWORK: score_duplicates(_targets(schemas)),
            BY_ATTENTION: score_duplicates(_targets(division.network)),
            PACNET: score_duplicates([targets for targets in nodes if len(targets)]),
        },
        "switches_pacnet_to_schema_network": {
            name: systems[PACNET][name]["switches"] / systems[SCHEMA_NETWORK][name]["switches"]
            for name in (*SCHEMAS, "all")
        },
        "systems": systems,
    }


def _targets(schemas: SchemaNetwork) -> list[Tensor]:
    return [schemas.targets(schema) for schema in range(len(schemas))]


def draw(
    episodes: Sequence[Episode], schemas: SchemaNetwork, scores: Mapping[str, Any]
) -> dict[str, Figure]:
    """Draw the paper's Figure 2, both systems side by side, and the switches."""
    first = {
        name: next(episode for episode in episodes if episode.behaviour == name) for name in SCHEMAS
    }
    shown = {
        name: Behaviour(name, episode.shown.phases, SCHEMAS[name])
        for name, episode in first.items()
    }
    panels = [
        (shown[name], {system: episode.winners[system] for system in (SCHEMA_NETWORK, PACNET)})
        for name, episode in first.items()
    ]
    toast = first["toast"]
    confidences = schemas(torch.from_numpy(toast.shown.percepts)).confidence.numpy()
    switches = {
        system: {name: values["switches"] for name, values in by_behaviour.items() if name != "all"}
        for system, by_behaviour in scores["systems"].items()
    }
    return {
        "figure2": winners_and_confidences(
            shown["toast"], toast.winners[SCHEMA_NETWORK], confidences, CONTROL_TIMESTEP, GRASPING
        ),
        "side_by_side": side_by_side(panels, CONTROL_TIMESTEP, len(schemas)),
        "switches": switches_per_episode(switches),
    }


def print_table(scores: Mapping[str, Any]) -> None:
    """Print the scores of all systems side by side."""
    print("\n" + " " * 34 + "".join(f"{system:>28}" for system in SYSTEMS))
    for row in ("switches", "task_success_rate", "in_order_rate", "strictly_in_order_rate",
                "own_share", "alternations_2_6"):  # fmt: skip
        for behaviour in (*SCHEMAS, "all"):
            values = [scores["systems"][system][behaviour].get(row) for system in SYSTEMS]
            if any(value is not None for value in values):
                _print_row(f"{row}, {behaviour}", values)
    for row in scores["duplicates"][PACNET]:
        _print_row(row, [scores["duplicates"].get(system, {}).get(row) for system in SYSTEMS])


def _print_row(name: str, values: Sequence[float | int | None]) -> None:
    shown = ["-" if value is None else f"{value:.4g}" for value in values]
    print(f"{name:34}" + "".join(f"{value:>28}" for value in shown))


if __name__ == "__main__":
    main()
