"""The command line: `pacnet COMMAND ...`, or `python -m pacnet COMMAND ...`.

Exit codes: 0 done, 1 failed (one line on stderr says why), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Sequence

import pacnet
from pacnet.cli import explain, export, fit, info, watch
from pacnet.cli.parsing import Formatter

_COMMANDS = (fit, info, watch, export, explain)
_EXTRAS = {"matplotlib": "figures", "rerun": "rerun", "lerobot": "datasets"}  # package -> extra
_FAILED, _INTERRUPTED = 1, 130
_EPILOG = """a first session:
  pacnet fit recordings/drinking --out imitator        learn every episode, in seconds
  pacnet info imitator                                 show what was learned
  pacnet watch imitator recordings/new --out pictures  show what is novel in other recordings
  pacnet explain imitator recordings/new --episode 0 --frame 120

Datasets are LeRobot datasets (format v3.0, v2.1 or v2.0): folders, or user/name of one that LeRobot
has downloaded. `pacnet COMMAND --help` describes a command."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code; on wrong usage argparse exits with 2.

    Args:
        argv: the arguments; None for those of the process.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # for terminals that lack a character
            stream.reconfigure(errors="replace")
    try:
        arguments = make_parser().parse_args(argv)
        with warnings.catch_warnings():  # ends what `show_notes` begins
            arguments.run(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:  # as after `| head`; Python must not flush at exit
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
    """Return the parser of all commands; each sets `run`, to be called with the arguments."""
    parser = argparse.ArgumentParser(
        prog="pacnet",
        description="Imitation learning in seconds: learn from demonstrations, detect what is "
        "novel, and show which demonstration an action comes from.",
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
