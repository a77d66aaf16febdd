"""What the parsers of the commands have in common."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TypeAlias

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""Where commands are added to the main parser."""
Run = Callable[[argparse.Namespace], None]
"""What a command does with its parsed arguments."""


def add_command(
    commands: Commands, name: str, summary: str, more: str, example: str, run: Run
) -> argparse.ArgumentParser:
    """A parser for a command, whose arguments are still to be added.

    Args:
        commands: of the main parser.
        name: of the command.
        summary: what it does, one line.
        more: what else there is to know before using it.
        example: command lines to copy.
        run: what it does with the parsed arguments.
    """
    parser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}. {more}",
        epilog=f"example:\n  {example}",
        formatter_class=Formatter,
    )
    parser.set_defaults(run=run)
    return parser


def add_checkpoint(parser: argparse.ArgumentParser) -> None:
    """The argument CHECKPOINT of the commands that use an imitator."""
    parser.add_argument(
        "checkpoint",
        metavar="CHECKPOINT",
        help="folder that `pacnet fit` wrote, or of a LeRobot policy of type pacnet",
    )


def add_dataset(parser: argparse.ArgumentParser) -> None:
    """The argument DATASET."""
    parser.add_argument(
        "dataset", metavar="DATASET", help="folder of a LeRobot dataset (format v3.0)"
    )


def natural(text: str) -> int:
    """A whole number ≥ 0, for argparse."""
    value = int(text)
    if value < 0:
        raise ValueError(text)
    return value


def positive(text: str) -> int:
    """A whole number ≥ 1, for argparse."""
    value = natural(text)
    if value < 1:
        raise ValueError(text)
    return value


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Wraps descriptions, and leaves text with indented lines, such as examples, as it is."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n  " in text:
            return super()._fill_text(text, width, indent)
        return argparse.HelpFormatter._fill_text(self, text, width, indent)
