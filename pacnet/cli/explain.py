"""`pacnet explain`: why an imitator would do what it would do at a frame of a dataset."""

from __future__ import annotations

import argparse

from pacnet.cli.parsing import Commands, add_checkpoint, add_command, add_dataset, natural
from pacnet.cli.printing import print_json

_MORE = """The episode is watched from its start up to the frame, as on the robot, for what comes
before a frame decides which behaviour it is part of. Shown are the node that wins and the nodes
next to it, the motor schemas that compete there, what is new, the target with the demonstrations
and frames that it came from, and the action."""
_EXAMPLE = "pacnet explain imitator recordings/new --episode 0 --frame 120"


def add_to(commands: Commands) -> None:
    """Adds the command to the main parser."""
    summary = "why an imitator does what it does at a frame: from which demonstrations, what is new"
    parser = add_command(commands, "explain", summary, _MORE, _EXAMPLE, run)
    add_checkpoint(parser)
    add_dataset(parser)
    parser.add_argument(
        "--episode", type=natural, required=True, metavar="E", help="number of the episode"
    )
    parser.add_argument(
        "--frame", type=natural, required=True, metavar="F", help="frame of the episode, from 0"
    )
    parser.add_argument("--json", action="store_true", help="print JSON, for machines")


def run(arguments: argparse.Namespace) -> None:
    """Explains one frame and prints it."""
    from pacnet.cli.explanation import explain
    from pacnet.cli.explanation_text import print_explanation
    from pacnet.cli.sources import load_imitator, load_percepts
    from pacnet.kernels.threads import use_one_thread

    use_one_thread()
    imitator = load_imitator(arguments.checkpoint)
    demonstrations = load_percepts(imitator, arguments.dataset)
    document = explain(imitator, demonstrations, arguments.episode, arguments.frame)
    if arguments.json:
        print_json(document)
    else:
        print_explanation(document)
