"""The command line: `pacnet COMMAND ...`, or `python -m pacnet COMMAND ...`.

Exit codes: 0 done, 1 failed (one line on stderr says why), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence

import pacnet
from pacnet.cli import explain, export, fit, info, watch
from pacnet.cli.parsing import Formatter

_COMMANDS = (fit, info, watch, export, explain)
_EXTRAS = {"matplotlib": "figures", "rerun": "rerun", "lerobot": "datasets"}  # package -> extra
_FAILED, _INTERRUPTED = 1, 130
_EPILOG = """a first session:
  pacnet fit recordings/drinking --out imitator        learn every episode, in seconds
  pacnet info imitator                                 what it has learned, and from what
  pacnet watch imitator recordings/new --out pictures  what is new in other recordings
  pacnet explain imitator recordings/new --episode 0 --frame 120

Datasets are LeRobot datasets (format v3.0) on disk. `pacnet COMMAND --help` tells about one."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; argparse itself exits with 2 where the usage is wrong.

    Args:
        argv: The arguments, those of the process if left out.

    Returns:
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal that lacks a sign shows another
            stream.reconfigure(errors="replace")
    try:
        arguments = make_parser().parse_args(argv)
        arguments.run(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:  # nobody reads on, as after `| head`; nor shall Python at its exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _FAILED
    except ModuleNotFoundError as error:
        if error.name not in _EXTRAS:
            raise
        extra = f"pip install 'pacnet[{_EXTRAS[error.name]}]'"
        return _fail(f"expected the package {error.name!r} to be installed: {extra}")
    except (OSError, ValueError) as error:
        return _fail(str(error))
    return 0


def make_parser() -> argparse.ArgumentParser:
    """The parser of all commands; each sets `run`, what it does with the parsed arguments."""
    parser = argparse.ArgumentParser(
        prog="pacnet",
        description="Imitation by attention: learns from demonstrations in seconds, "
        "tells what is new, and shows which demonstration is behind an action.",
        epilog=_EPILOG,
        formatter_class=Formatter,
    )
    parser.add_argument("--version", action="version", version=f"pacnet {pacnet.__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in _COMMANDS:
        command.add_to(commands)
    return parser


def _fail(reason: str) -> int:
    print(f"error: {' '.join(reason.split())}", file=sys.stderr)
    return _FAILED
