"""`pacnet export`: copy a dataset, with an imitator's output as extra columns."""

from __future__ import annotations

import argparse
from pathlib import Path

from pacnet.cli.parsing import (
    Commands,
    add_checkpoint,
    add_command,
    add_dataset,
    add_task,
    path,
)
from pacnet.cli.printing import counted, print_pairs, progress_bar

_DETAILS = """The copy is a LeRobot dataset with extra columns: behaviour (probability of each known
task), progress in the likeliest, novelty (above 1 is novel), is_novel, winner (node of the map, -1
without a match), expected_next and expected_end (percepts). LeRobot's policies ignore them. The
copy is of format v3.0, whatever that of the dataset is. Videos are the same files, hard-linked
where the file system can. With a choice of episodes the copy has these alone, numbered from 0."""
_EXAMPLE = "pacnet export imitator recordings/new --out recordings/new_annotated"


def add_to(commands: Commands) -> None:
    """Add the command to the main parser."""
    summary = "copy a dataset, with what an imitator recognises as extra columns"
    parser = add_command(commands, "export", summary, _DETAILS, _EXAMPLE, run)
    add_checkpoint(parser)
    add_dataset(parser)
    add_task(parser)
    parser.add_argument(
        "--out", type=path, metavar="DIR", required=True,
        help="folder of the copy; it must not exist yet",
    )  # fmt: skip
    parser.add_argument("--no-videos", action="store_true", help="leave videos out of the copy")


def run(arguments: argparse.Namespace) -> None:
    """Check that the copy can be written, run over all episodes, and write it."""
    from pacnet.cli.loading import load_imitator, load_percepts
    from pacnet.cli.replay import replay
    from pacnet.datasets.annotations import check_annotatable, write_annotated
    from pacnet.evaluation.recognized import column_names, column_values

    if Path(arguments.out).exists():
        raise FileExistsError(f"expected a new folder for the copy, {arguments.out} exists")
    imitator = load_imitator(arguments.checkpoint, arguments.task)
    demonstrations = load_percepts(imitator, arguments)
    columns = column_names(imitator.tasks, imitator.percept_names)
    source, episodes = arguments.dataset, [shown.episode for shown in demonstrations]
    options = {"videos": not arguments.no_videos, "skip_damaged": arguments.skip_damaged}
    check_annotatable(source, columns, selected=episodes, **options)
    replayed = replay(imitator, demonstrations, arguments.task)
    values = [column_values(episode.recognized.recognition) for episode in replayed]
    with progress_bar("copying", sum(len(shown.state) for shown in demonstrations)) as progress:
        write_annotated(
            source, arguments.out, columns, values,
            selected=episodes, progress=progress, **options,
        )  # fmt: skip
    print_pairs(
        [
            ("dataset", f"{arguments.out}, {counted(len(demonstrations), 'episode')}"),
            ("new columns", ", ".join(columns)),
        ]
    )
