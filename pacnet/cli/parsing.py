"""What the parsers of the commands have in common."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
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
        "dataset", type=path, metavar="DATASET", help="folder of a LeRobot dataset (format v3.0)"
    )


def natural(text: str) -> int:
    """A whole number ≥ 0, for argparse."""
    return _whole(text, 0)


def positive(text: str) -> int:
    """A whole number ≥ 1, for argparse."""
    return _whole(text, 1)


def _whole(text: str, least: int) -> int:
    expected = argparse.ArgumentTypeError(f"expected a whole number ≥ {least}, got {text!r}")
    try:
        value = int(text)
    except ValueError:
        raise expected from None
    if value < least:
        raise expected
    return value


def path(text: str) -> str:
    """The name of a file or folder, for argparse; an empty one would mean the working folder."""
    if not text:
        raise argparse.ArgumentTypeError("expected the name of a file or folder, got an empty one")
    return text


def check_folder(option: str, folder: str) -> None:
    """Refuses a file where a folder is to be written to.

    Raises:
        ValueError: there is a file of that name.
    """
    if Path(folder).exists() and not Path(folder).is_dir():
        raise ValueError(f"expected {option} as a folder, '{folder}' is a file")


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Wraps descriptions, and leaves text with indented lines, such as examples, as it is."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n  " in text:
            return super()._fill_text(text, width, indent)
        return argparse.HelpFormatter._fill_text(self, text, width, indent)
