"""Recognises, acting on nothing, the behaviours in a LeRobot dataset by a taught checkpoint.

Each episode is watched from its start. At each frame the network says which of the behaviours it
was taught this is, how far along, what comes next and at the end, and how new it is. Writes a copy
of the dataset with these as extra columns, figures of the first episodes and scores into
`runs/recognise/<time>-seed<N>/`. Nothing is drawn at random: the seed names the folder, no more.

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
    STATE,
    Demonstrations,
    dimension_names,
    load_demonstrations,
)
from pacnet.evaluation.recognised import Watched, column_names, column_values, joined, shown
from pacnet.evaluation.recognition_figures import recognition_over_time
from pacnet.kernels.threads import use_one_thread
from train.common.runs import make_parser, natural, run_folder, save_figures, write_metrics
from train.postural.recognition.scores import print_table, score_all, score_episode

CHUNK = 50  # samples between two steps of the progress bar


def parse_arguments() -> argparse.Namespace:
    """The command line."""
    parser = make_parser("train.recognise", __doc__)
    parser.add_argument("checkpoint", help="folder of a taught network")
    parser.add_argument("dataset", help="folder of a LeRobot dataset (format v3.0)")
    parser.add_argument("--figures", type=natural, default=8, help="first episodes to draw")
    return parser.parse_args()


def main() -> None:
    """Load, watch, show."""
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
    """What there is to watch in a dataset; nobody needs to have acted in it."""
    return load_demonstrations(dataset, action=STATE)


def check(network: PACNet, demonstrations: Demonstrations) -> None:
    """Refuses a network that does not take such percepts, or cannot recognise anything."""
    takes, got = network.config.attention.dimensions, len(dimension_names(demonstrations.names))
    if takes != got:
        raise ValueError(
            f"expected percepts of {takes} dimensions, as the checkpoint takes, "
            f"got {got} from the dataset's {' and '.join(demonstrations.names)}"
        )
    network.recognise(demonstrations.episodes[0].percepts[:1])


def run(
    arguments: argparse.Namespace, network: PACNet, demonstrations: Demonstrations, folder: Path
) -> None:
    """Recognition of all episodes, its scores, figures and dataset."""
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
    """Whether a copy of the dataset will be written; if not, says at once why."""
    try:
        check_annotatable(dataset, columns)
    except ValueError as error:
        print(f"note: no copy of the dataset will be written: {error}", file=sys.stderr)
        return False
    return True


def watch(network: PACNet, demonstrations: Demonstrations) -> list[Watched]:
    """Recognises one episode after the other, each from its start."""
    watched = []
    total = sum(len(demonstration.state) for demonstration in demonstrations)
    with tqdm(total=total, desc="recognising", unit="sample") as progress:
        for demonstration in demonstrations:
            network.reset()
            parts = []
            for percepts in demonstration.percepts.split(CHUNK):
                parts.append(network.recognise(percepts))
                progress.update(len(percepts))
            watched.append(Watched(demonstration, joined(parts)))
    return watched


def draw(watched: Sequence[Watched], network: PACNet, fps: float) -> dict[str, Figure]:
    """Name -> figure of each episode."""
    schemas = network.config.schemas
    assert isinstance(schemas, CompetingSchemasConfig)  # else nothing had been recognised
    titles, threshold = shown(network.behaviours), schemas.recognition.novel_above
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
