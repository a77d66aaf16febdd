"""`pacnet export`: a copy of a dataset with what an imitator saw in it as extra columns."""

from __future__ import annotations

import argparse
from pathlib import Path

from pacnet.cli.parsing import Commands, add_checkpoint, add_command, add_dataset, path
from pacnet.cli.printing import counted, print_pairs

_MORE = """The copy is a LeRobot dataset with these columns more: behaviour (the probability of each
that is known), progress, novelty (over what is tolerated), is_novel, winner (node of the map, -1
without a match), expected_next and expected_end (percepts). LeRobot's policies leave them alone.
Datasets with images cannot be copied."""
_EXAMPLE = "pacnet export imitator recordings/new --out recordings/new_annotated"


def add_to(commands: Commands) -> None:
    """Adds the command to the main parser."""
    summary = "copy a dataset, with what an imitator sees in it as extra columns"
    parser = add_command(commands, "export", summary, _MORE, _EXAMPLE, run)
    add_checkpoint(parser)
    add_dataset(parser)
    parser.add_argument(
        "--out", type=path, metavar="DIR", required=True,
        help="folder of the copy, which must not exist yet",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Checks that the copy can be written, watches, and writes it."""
    from pacnet.cli.seen import see
    from pacnet.cli.sources import load_imitator, load_percepts
    from pacnet.datasets.annotations import check_annotatable, write_annotated
    from pacnet.evaluation.recognized import column_names, column_values

    if Path(arguments.out).exists():
        raise FileExistsError(f"expected a folder to be made for the copy, {arguments.out} exists")
    imitator = load_imitator(arguments.checkpoint)
    demonstrations = load_percepts(imitator, arguments.dataset)
    columns = column_names(imitator.network.behaviours, imitator.percept_names)
    check_annotatable(arguments.dataset, columns)
    values = (column_values(one.watched.recognition) for one in see(imitator, demonstrations))
    write_annotated(arguments.dataset, arguments.out, columns, values)
    print_pairs(
        [
            ("dataset", f"{arguments.out}, {counted(len(demonstrations), 'episode')}"),
            ("new columns", ", ".join(columns)),
        ]
    )
