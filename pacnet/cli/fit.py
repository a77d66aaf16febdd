"""`pacnet fit`: learn the demonstrations of a dataset."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from pacnet.cli.parsing import (
    Commands,
    add_command,
    add_dataset,
    check_folder,
    path,
    whole_number,
)
from pacnet.cli.printing import counted, print_pairs, progress_bar, size_text
from pacnet.cli.reports import describe_reports, print_reports

if TYPE_CHECKING:
    from pacnet.datasets.demonstrations import Demonstrations
    from pacnet.imitator.imitator import Imitator

_DETAILS = """Every episode is learned once, in order. A percept is the state, followed by the
environment state if the dataset has one; images are ignored. All settings are chosen from the
data."""
_EXAMPLES = """pacnet fit recordings/drinking --out imitator
  pacnet fit recordings/toasting --from imitator --out imitator
  pacnet fit recordings/corrections --corrections --from imitator --out imitator"""
_NO_TARGETS = (
    "no targets were stored, so the imitator never acts: no node of the map won for long enough to "
    "habituate; record longer episodes, or more of them"
)


def add_to(commands: Commands) -> None:
    """Add the command to the main parser."""
    summary = "learn the demonstrations of a dataset, in seconds"
    parser = add_command(commands, "fit", summary, _DETAILS, _EXAMPLES, run)
    add_dataset(parser)
    parser.add_argument(
        "--out", type=path, metavar="DIR", required=True, help="folder to write the checkpoint to"
    )
    parser.add_argument(
        "--from", dest="origin", metavar="CHECKPOINT",
        help="continue from this imitator: it keeps what it knows, its features and its scale",
    )  # fmt: skip
    parser.add_argument(
        "--corrections", action="store_true",
        help="with --from: the episodes show what to do where percepts were novel; the thresholds "
        "of novelty stay as they are, however many episodes there are",
    )  # fmt: skip
    parser.add_argument(
        "--state", metavar="NAME", help="feature that is the state (observation.state)"
    )
    parser.add_argument(
        "--environment-state", metavar="NAME",
        help="feature that is the environment state, or none to leave it out "
        "(observation.environment_state if the dataset has it)",
    )  # fmt: skip
    parser.add_argument("--action", metavar="NAME", help="feature that is the action (action)")
    parser.add_argument(
        "--targets", choices=("action", "state"),
        help="what is stored for each frame: its action (the default), or the state some frames "
        "later, to which a forward model, fitted to the same data, finds the action",
    )  # fmt: skip
    parser.add_argument(
        "--lead", type=whole_number(1), metavar="N",
        help="with --targets state: number of frames that the state lies ahead (1)",
    )  # fmt: skip
    parser.add_argument(
        "--overwrite", action="store_true",
        help="replace a checkpoint in DIR; not needed if --from is DIR too",
    )  # fmt: skip
    parser.set_defaults(usage_error=parser.error)


def run(arguments: argparse.Namespace) -> None:
    """Learn, write the checkpoint and print what was learned."""
    _check_usage(arguments)
    from pacnet.cli.loading import checkpoint_folder
    from pacnet.core.interrupts import defer_sigint
    from pacnet.kernels.threads import use_one_thread

    folder = checkpoint_folder(arguments.out)
    _check_out(arguments, folder)
    use_one_thread()
    imitator, demonstrations = _prepare(arguments)
    began = time.perf_counter()
    frames = _learn(imitator, demonstrations, arguments.corrections)
    seconds = time.perf_counter() - began
    with defer_sigint():
        imitator.save_pretrained(folder)
    _print(imitator, len(demonstrations), frames, seconds, folder)


def _check_usage(arguments: argparse.Namespace) -> None:
    if arguments.lead is not None and arguments.targets != "state" and arguments.origin is None:
        arguments.usage_error("argument --lead: only with --targets state")
    if arguments.corrections and arguments.origin is None:
        arguments.usage_error("argument --corrections: only with --from")
    for option in ("targets", "lead"):
        if arguments.origin is not None and getattr(arguments, option) is not None:
            arguments.usage_error(f"argument --{option}: not with --from, which has its own")


def _check_out(arguments: argparse.Namespace, folder: Path) -> None:
    """Raise a ValueError if writing would replace a checkpoint unasked."""
    from pacnet.cli.loading import checkpoint_folder
    from pacnet.core.checkpoint import TENSOR_FILE

    out, origin = arguments.out, arguments.origin
    check_folder("--out", out)
    continues = origin is not None and folder.resolve() == checkpoint_folder(origin).resolve()
    if (folder / TENSOR_FILE).exists() and not continues and not arguments.overwrite:
        raise ValueError(
            f"expected a folder without a checkpoint, '{out}' has one: continue from it with "
            f"--from {out}, or replace it with --overwrite"
        )


def _prepare(arguments: argparse.Namespace) -> tuple[Imitator, Demonstrations]:
    """Return the imitator and the demonstrations it is to learn."""
    from pacnet.cli.loading import feature_names, load_imitator
    from pacnet.datasets.demonstrations import load_demonstrations
    from pacnet.imitator.imitator import Imitator

    imitator = None if arguments.origin is None else load_imitator(arguments.origin)
    features = {} if imitator is None else feature_names(imitator)
    for name in ("state", "environment_state", "action"):
        if getattr(arguments, name) is not None:
            features[name] = getattr(arguments, name)
    if features.get("environment_state") == "none":
        features["environment_state"] = None
    demonstrations = load_demonstrations(arguments.dataset, **features)  # pyright: ignore[reportArgumentType]
    if imitator is None:
        targets, lead = arguments.targets or "action", arguments.lead or 1
        imitator = Imitator.from_demonstrations(demonstrations, targets, lead)
    return imitator, demonstrations


def _learn(imitator: Imitator, demonstrations: Demonstrations, corrections: bool) -> int:
    """Learn, with a progress bar; return the number of frames."""
    frames = sum(len(shown.state) for shown in demonstrations)
    if imitator.forward_model is not None and not imitator.reports:
        transitions = counted(frames - len(demonstrations), "transition")
        print(f"fitting the forward model to {transitions} ...", file=sys.stderr)
    with progress_bar("learning", frames) as advance:
        imitator.learn(demonstrations, advance, corrections=corrections)
    return frames


def _print(imitator: Imitator, episodes: int, frames: int, seconds: float, folder: Path) -> None:
    from pacnet.cli.loading import size_of

    print_reports(describe_reports(imitator)[-episodes:])
    print()
    lengths, total = imitator.network.schemas.lengths, len(imitator.reports)
    learned = f"{counted(episodes, 'episode')}, {counted(frames, 'frame')} in {seconds:.1f} s"
    if total > episodes:
        learned += f" ({counted(total, 'episode')} in all)"
    print_pairs(
        [
            ("learned", learned),
            ("nodes", f"{len(imitator.network.sofm):,}"),
            ("schemas", f"{len(lengths):,}"),
            ("targets", f"{int(lengths.sum()):,} {imitator.config.targets}s"),
            ("checkpoint", f"{folder}, {size_text(size_of(folder))}"),
        ]
    )
    if not int(lengths.sum()):
        print(f"note: {_NO_TARGETS}", file=sys.stderr)
