"""Arguments that several commands share, and the layout of their help."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
"""Where commands are added to the main parser."""

_MOST_EPISODES = 1_000_000  # in a list of numbers


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


def add_dataset(parser: argparse.ArgumentParser, about_episodes: str | None = None) -> None:
    """Add the argument DATASET, and the options that say which episodes of it are read.

    Args:
        parser: of a command.
        about_episodes: what the help says of these options.
    """
    parser.add_argument(
        "dataset", type=path, metavar="DATASET",
        help="folder of a LeRobot dataset (format v3.0, v2.1 or v2.0), or user/name of one that "
        "LeRobot has downloaded",
    )  # fmt: skip
    group = parser.add_argument_group("which episodes of the dataset", about_episodes)
    group.add_argument(
        "--episodes", type=numbers, action="extend", metavar="LIST",
        help="only these, as in 0,2,5-9 (all)",
    )  # fmt: skip
    group.add_argument(
        "--exclude", type=numbers, action="extend", metavar="LIST", default=[],
        help="not these, as in 3,7-8",
    )  # fmt: skip
    group.add_argument(
        "--skip-damaged", action="store_true",
        help="leave out files that cannot be read and incomplete episodes, and list them",
    )  # fmt: skip


def add_task(parser: argparse.ArgumentParser) -> None:
    """Add the option --task."""
    parser.add_argument(
        "--task", metavar="TEXT",
        help="follow only what was shown for this task, in the words of the demonstrations; all "
        "else is novel (whatever fits)",
    )  # fmt: skip


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


def numbers(text: str) -> list[int]:
    """Return the numbers of a list such as 0,2,5-9, for argparse."""
    ranges = [re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", part.strip()) for part in text.split(",")]
    if not all(ranges):
        raise argparse.ArgumentTypeError(
            f"expected numbers and ranges of episodes, such as 0,2,5-9, got {text!r}"
        )
    found: list[int] = []
    for first, last in (part.groups() for part in ranges if part):
        added = range(int(first), int(last or first) + 1)
        if not added:
            raise argparse.ArgumentTypeError(
                f"expected ranges from a lower to a higher number, got {first}-{last}"
            )
        if len(found) + len(added) > _MOST_EPISODES:
            raise argparse.ArgumentTypeError(
                f"expected at most {_MOST_EPISODES:,} episodes, got {text!r}"
            )
        found += added
    return found


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
