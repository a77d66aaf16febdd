"""Arguments that several commands share, and the layout of their help."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""Where commands are added to the main parser."""


def add_command(
    commands: Commands,
    name: str,
    summary: str,
    details: str,
    examples: str,
    run: Callable[[argparse.Namespace], None],
) -> argparse.ArgumentParser:
    """Add a command to the main parser; return its own parser, still without arguments."""
    parser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}. {details}",
        epilog=f"example:\n  {examples}",
        formatter_class=Formatter,
    )
    parser.set_defaults(run=run)
    return parser


def add_checkpoint(parser: argparse.ArgumentParser) -> None:
    """Add the argument CHECKPOINT."""
    parser.add_argument(
        "checkpoint", metavar="CHECKPOINT",
        help="folder written by `pacnet fit`, or of a LeRobot policy of type pacnet",
    )  # fmt: skip


def add_dataset(parser: argparse.ArgumentParser) -> None:
    """Add the argument DATASET."""
    parser.add_argument(
        "dataset", type=path, metavar="DATASET", help="folder of a LeRobot dataset (format v3.0)"
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the option --json."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def whole_number(lowest: int) -> Callable[[str], int]:
    """Return a parser of whole numbers ≥ `lowest`, for argparse."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = lowest - 1
        if value < lowest:
            raise argparse.ArgumentTypeError(f"expected a whole number ≥ {lowest}, got {text!r}")
        return value

    return parse


def path(text: str) -> str:
    """Return the name of a file or folder, for argparse; empty would mean the current folder."""
    if not text:
        raise argparse.ArgumentTypeError("expected the name of a file or folder, got an empty one")
    return text


def check_folder(option: str, folder: str) -> None:
    """Raise a ValueError if there is a file where a folder is to be written."""
    if Path(folder).exists() and not Path(folder).is_dir():
        raise ValueError(f"expected {option} as a folder, '{folder}' is a file")


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Formatter that wraps paragraphs, but not text with indented lines, such as examples."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n  " in text:
            return super()._fill_text(text, width, indent)
        return argparse.HelpFormatter._fill_text(self, text, width, indent)
