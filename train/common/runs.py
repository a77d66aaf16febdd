"""What every script needs: arguments, the folder of a run, `metrics.json`, checkpoints."""

from __future__ import annotations

import argparse
import datetime
import importlib.metadata
import json
import math
import os
import platform
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from pacnet import PACNet

UNSEEN_ARENAS = 10_000  # first seed of the arenas for tests; none of them is learned in
_PACKAGES = ("pacnet", "torch", "numpy", "mujoco", "dm-control", "gymnasium", "lerobot")


def make_parser(
    module: str, description: str | None, episodes: int | None = None
) -> argparse.ArgumentParser:
    """Return a parser with the arguments that every script has.

    Args:
        module: As in `python -m MODULE`.
        description: Of the script.
        episodes: Default number of recall episodes; None for a script without any.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m {module}",
        description=description,
        formatter_class=_HelpFormatter,
    )
    parser.add_argument("--seed", type=natural, default=0, help="seed of all random numbers")
    if episodes is not None:
        parser.add_argument(
            "--episodes", type=positive, default=episodes, help="new episodes to recall and score"
        )
    parser.add_argument("--runs", default="runs", help="folder of all runs")
    return parser


def natural(text: str) -> int:
    """Parse an integer ≥ 0."""
    return _integer(text, 0)


def positive(text: str) -> int:
    """Parse an integer ≥ 1."""
    return _integer(text, 1)


def factor(text: str) -> float:
    """Parse a number from 0.1 to 10."""
    return number(text, 0.1, 10.0, "a number from 0.1 to 10")


def number(text: str, lowest: float, highest: float, wanted: str) -> float:
    """Parse a number from `lowest` to `highest`, or say that `wanted` was expected."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not lowest <= value <= highest:
        raise argparse.ArgumentTypeError(f"expected {wanted}, got '{text}'")
    return value


def threshold(text: str) -> float:
    """Parse a number in (0, 1)."""
    return number(text, math.ulp(0.0), 1 - 2**-53, "a number in (0, 1)")


def taught_arena(text: str) -> str | int:
    """Parse "paper" or the seed of an arena to learn in."""
    if text == "paper":
        return text
    seed = natural(text)
    if seed >= UNSEEN_ARENAS:
        raise argparse.ArgumentTypeError(
            f"expected paper or a seed below {UNSEEN_ARENAS}, got '{text}' (reserved for tests)"
        )
    return seed


def usable_cores() -> int:
    """Return the number of processes to use: the cores that this one may use, at most eight."""
    return min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1, 8)


def make_run_folder(name: str, seed: int, runs: str | Path = "runs") -> Path:
    """Make the folder `runs/NAME/<time>-seed<N>/`; append a number if it exists.

    Args:
        name: Of the script.
        seed: Of the run.
        runs: Folder of all runs.
    """
    stem = f"{datetime.datetime.now():%Y%m%d-%H%M%S}-seed{seed}"
    for suffix in ("", *(f"-{number}" for number in range(2, 100))):
        folder = Path(runs) / name / (stem + suffix)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise SystemExit(f"error: expected a folder for runs, got {error}") from error
        return folder
    raise SystemExit(f"error: expected a free name like '{folder}', found none")


@contextmanager
def run_folder(name: str, seed: int, runs: str | Path) -> Iterator[Path]:
    """Yield a run's new folder; after Ctrl-C exit and print what the run leaves behind."""
    folder = make_run_folder(name, seed, runs)
    try:
        yield folder
    except KeyboardInterrupt:
        print(f"\nInterrupted. Finished results are in {folder}", file=sys.stderr)
        raise SystemExit(130) from None


def command_line(module: str, arguments: argparse.Namespace) -> str:
    """Return the command that gives the same numbers again, with its defaults written out."""
    given = {name: value for name, value in vars(arguments).items() if name != "runs"}
    checkpoint = [str(given.pop("checkpoint"))] if "checkpoint" in given else []
    options = [f"--{name.replace('_', '-')} {value}" for name, value in given.items()]
    return " ".join(["python", "-m", module, *checkpoint, *options])


def write_metrics(path: Path, command: str, seed: int, scores: Mapping[str, Any]) -> None:
    """Write scores with the command, the seed and the versions that made them."""
    versions = {"python": platform.python_version()}
    versions |= {package: importlib.metadata.version(package) for package in _PACKAGES}
    document = {"command": command, "seed": seed, "versions": versions, **scores}
    path.write_text(json.dumps(document, indent=2) + "\n")


def save_figures(folder: Path, figures: Mapping[str, Figure]) -> None:
    """Write each figure as `NAME.png`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=150)


def load_or_exit(checkpoint: str | Path, percepts: int, targets: int) -> PACNet:
    """Load a checkpoint to recall from; if it does not fit, exit with one line that says why.

    Args:
        checkpoint: Its folder.
        percepts: Dimensions of a percept that it must have.
        targets: Dimensions of a target that it must have.
    """
    try:
        network = PACNet.from_pretrained(checkpoint).eval()
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}") from error
    config = network.config
    got = (config.attention.dimensions, config.schemas.target_dimensions)
    if got != (percepts, targets):
        raise SystemExit(
            f"error: expected a checkpoint of {percepts} percept and {targets} target dimensions, "
            f"got {got[0]} and {got[1]} in '{checkpoint}'"
        )
    return network


class _HelpFormatter(argparse.ArgumentDefaultsHelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Show defaults, and the description without reformatting it."""


def _integer(text: str, lowest: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = lowest - 1
    if value < lowest:
        raise argparse.ArgumentTypeError(f"expected an integer ≥ {lowest}, got '{text}'")
    return value
