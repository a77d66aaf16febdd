"""Recognize the behaviours in a LeRobot dataset with a trained checkpoint, without acting.

Each episode is watched from its start. For each frame the network gives the probability of each
behaviour, the progress, the expected next and last percepts, and the novelty. Writes a copy of the
dataset with these as extra columns, figures of the first episodes and scores into
`runs/recognise/<time>-seed<N>/`. Nothing is random; the seed only names the folder.

A percept is `observation.state`, followed by `observation.environment_state` if there is one.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure
from tqdm import tqdm

from pacnet import PACNet
from pacnet.competition.config import CompetingSchemasConfig
from pacnet.datasets.annotations import check_annotatable, write_annotated
from pacnet.datasets.demonstrations import (
    Demonstrations,
    dimension_names,
    load_demonstrations,
)
from pacnet.evaluation.recognition_figures import recognition_over_time
from pacnet.evaluation.recognized import (
    RecognizedEpisode,
    column_names,
    column_values,
    concatenate,
    display_names,
)
from pacnet.kernels.threads import use_one_thread
from train.common.runs import make_parser, natural, run_folder, save_figures, write_metrics
from train.postural.recognition.scores import print_table, score_all, score_episode

CHUNK = 50  # samples between two steps of the progress bar


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.recognise", __doc__)
    parser.add_argument("checkpoint", help="folder of a trained network")
    parser.add_argument("dataset", help="folder of a LeRobot dataset (format v3.0)")
    parser.add_argument(
        "--figures", type=natural, default=8, help="number of episodes to draw, from the first on"
    )
    return parser.parse_args()


def main() -> None:
    """Load network and dataset, check both, and recognize the episodes."""
    arguments = parse_arguments()
    try:
        network = PACNet.from_pretrained(arguments.checkpoint).eval()
        demonstrations = load_percepts(Path(arguments.dataset))
        check(network, demonstrations)
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}") from error
    with run_folder("recognise", arguments.seed, arguments.runs) as folder:
        run(arguments, network, demonstrations, folder)


def load_percepts(dataset: Path) -> Demonstrations:
    """Load the percepts of a dataset, which needs no actions."""
    return load_demonstrations(dataset, action=None)


def check(network: PACNet, demonstrations: Demonstrations) -> None:
    """Refuse a network that does not fit the percepts, or cannot recognize anything."""
    takes, got = network.config.attention.dimensions, len(dimension_names(demonstrations.names))
    if takes != got:
        raise ValueError(
            f"expected percepts of {takes} dimensions, as in the checkpoint, "
            f"got {got} from the dataset's {' and '.join(demonstrations.names)}"
        )
    network.recognise(demonstrations.episodes[0].percepts[:1])


def run(
    arguments: argparse.Namespace, network: PACNet, demonstrations: Demonstrations, folder: Path
) -> None:
    """Recognize all episodes; write scores, figures and the dataset."""
    use_one_thread()
    columns = column_names(network.behaviours, dimension_names(demonstrations.names))
    copies = is_copied(arguments.dataset, columns)
    watched = watch(network, demonstrations)
    episodes = [score_episode(one, network.behaviours, demonstrations.fps) for one in watched]
    totals = score_all(watched, network.behaviours)
    scores = {"behaviours": network.behaviours, **totals, "episodes": episodes}
    options = ["--seed", str(arguments.seed), "--figures", str(arguments.figures)]
    command = ["python", "-m", "train.recognise", arguments.checkpoint, arguments.dataset, *options]
    write_metrics(folder / "metrics.json", shlex.join(command), arguments.seed, scores)
    save_figures(
        folder / "figures", draw(watched[: arguments.figures], network, demonstrations.fps)
    )
    print_table(episodes, totals)
    print(f"\nscores    {folder / 'metrics.json'}\nfigures   {folder / 'figures'}")
    if copies:
        values = (column_values(one.recognition) for one in watched)
        write_annotated(arguments.dataset, folder / "dataset", columns, values)
        print(f"dataset   {folder / 'dataset'}")


def is_copied(dataset: str, columns: Mapping[str, Sequence[str]]) -> bool:
    """Return whether the dataset can be copied; print a note if not."""
    try:
        check_annotatable(dataset, columns)
    except ValueError as error:
        print(f"note: the dataset will not be copied: {error}", file=sys.stderr)
        return False
    return True


def watch(network: PACNet, demonstrations: Demonstrations) -> list[RecognizedEpisode]:
    """Recognize one episode after the other, each from its start."""
    watched = []
    total = sum(len(demonstration.state) for demonstration in demonstrations)
    with tqdm(total=total, desc="recognising", unit="sample") as progress:
        for demonstration in demonstrations:
            network.reset()
            parts = []
            for percepts in demonstration.percepts.split(CHUNK):
                parts.append(network.recognise(percepts))
                progress.update(len(percepts))
            watched.append(RecognizedEpisode(demonstration, concatenate(parts)))
    return watched


def draw(watched: Sequence[RecognizedEpisode], network: PACNet, fps: float) -> dict[str, Figure]:
    """Return name -> figure of each episode."""
    schemas = network.config.schemas
    assert isinstance(schemas, CompetingSchemasConfig)  # check() has recognized a percept
    titles, threshold = display_names(network.behaviours), schemas.recognition.novel_above
    figures = {}
    for one in tqdm(watched, "drawing", unit="figure"):
        number, task = one.demonstration.episode, one.demonstration.task
        title = f"Episode {number}, recorded as “{task}”"
        figures[f"episode_{number:03}"] = recognition_over_time(
            one.recognition, titles, threshold, 1 / fps, title
        )
    return figures


if __name__ == "__main__":
    main()
