"""`pacnet fit`: learns the demonstrations of a dataset."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from pacnet.cli.lessons import lessons_of, print_lessons
from pacnet.cli.parsing import Commands, add_command, add_dataset, check_folder, path, positive
from pacnet.cli.printing import counted, print_pairs, size_text

if TYPE_CHECKING:
    from pacnet.datasets.demonstrations import Demonstrations
    from pacnet.imitator.imitator import EpisodeReport, Imitator

_MORE = """Every episode is watched once, in order, as it would be on the robot. Percepts are the
state, followed by the environment state if the dataset has one; images are left alone. The map's
settings follow from the data."""
_EXAMPLE = """pacnet fit recordings/drinking --out imitator
  pacnet fit recordings/toasting --from imitator --out imitator
  pacnet fit recordings/corrections --corrections --from imitator --out imitator"""
_TARGETS, _LEAD = "action", 1
_NOTHING_KEPT = """no targets were kept, so there is nothing to act by: no node of the map won for
long enough to habituate; show longer episodes, or more of them""".replace("\n", " ")


def add_to(commands: Commands) -> None:
    """Adds the command to the main parser."""
    summary = "learn the demonstrations of a dataset, in seconds"
    parser = add_command(commands, "fit", summary, _MORE, _EXAMPLE, run)
    add_dataset(parser)
    parser.add_argument(
        "--out", type=path, metavar="DIR", required=True, help="folder to write the checkpoint to"
    )
    parser.add_argument(
        "--from", dest="origin", metavar="CHECKPOINT",
        help="go on from what this imitator knows: nothing is forgotten, and its features and the "
        "scale of its percepts stay what they are",
    )  # fmt: skip
    parser.add_argument(
        "--corrections", action="store_true",
        help="with --from: the episodes show what to do where something was new; what is tolerated "
        "elsewhere stays what it is, however many they are",
    )  # fmt: skip
    parser.add_argument(
        "--state", metavar="NAME", help="feature that is the state (observation.state)"
    )
    parser.add_argument(
        "--environment-state", metavar="NAME",
        help="feature that is the state of the surroundings; none leaves it out "
        "(observation.environment_state where the dataset has it)",
    )  # fmt: skip
    parser.add_argument("--action", metavar="NAME", help="feature that is the action (action)")
    parser.add_argument(
        "--targets", choices=("action", "state"),
        help="what is remembered: the action of each frame (the default), or the state some frames "
        "later, to which a forward model, fitted to the same data, finds the action",
    )  # fmt: skip
    parser.add_argument(
        "--lead", type=positive, metavar="N",
        help=f"frames that a state lies ahead, with --targets state ({_LEAD})",
    )  # fmt: skip
    parser.add_argument(
        "--overwrite", action="store_true",
        help="replace the checkpoint that is in DIR; not needed where --from is DIR too",
    )  # fmt: skip
    parser.set_defaults(usage_error=parser.error)


def run(arguments: argparse.Namespace) -> None:
    """Learns and writes the checkpoint."""
    _check_usage(arguments)
    _check_out(arguments)
    from pacnet.cli.sources import checkpoint_folder
    from pacnet.core.interrupts import defer_sigint
    from pacnet.kernels.threads import use_one_thread

    use_one_thread()
    imitator, demonstrations = _prepare(arguments)
    began = time.perf_counter()
    lessons = _learn(imitator, demonstrations, arguments.corrections)
    seconds = time.perf_counter() - began
    folder = checkpoint_folder(arguments.out)
    with defer_sigint():
        imitator.save_pretrained(folder)
    _report(imitator, lessons, seconds, folder)
    if not int(imitator.network.schemas.lengths.sum()):
        print(f"note: {_NOTHING_KEPT}", file=sys.stderr)


def _check_usage(arguments: argparse.Namespace) -> None:
    if arguments.lead is not None and arguments.targets != "state" and arguments.origin is None:
        arguments.usage_error("argument --lead: only with --targets state")
    if arguments.corrections and arguments.origin is None:
        arguments.usage_error("argument --corrections: only with --from, whose known is corrected")
    for option in ("targets", "lead"):
        if arguments.origin is not None and getattr(arguments, option) is not None:
            arguments.usage_error(f"argument --{option}: not with --from, whose own stays")


def _check_out(arguments: argparse.Namespace) -> None:
    """Refuses to write where something would be lost, before anything is done."""
    from pacnet.cli.sources import checkpoint_folder
    from pacnet.core.checkpoint import TENSOR_FILE

    check_folder("--out", arguments.out)
    folder, out = checkpoint_folder(arguments.out), Path(arguments.out)
    origin = arguments.origin
    goes_on = origin is not None and folder.resolve() == checkpoint_folder(origin).resolve()
    if (folder / TENSOR_FILE).exists() and not goes_on and not arguments.overwrite:
        raise ValueError(
            f"expected a folder without a checkpoint, '{out}' holds one: go on from it with "
            f"--from {out}, or replace it with --overwrite"
        )


def _prepare(arguments: argparse.Namespace) -> tuple[Imitator, Demonstrations]:
    """The imitator to teach, and what it is to learn."""
    from pacnet.cli.sources import feature_names, load_imitator
    from pacnet.datasets.demonstrations import load_demonstrations
    from pacnet.imitator.imitator import Imitator

    known = None if arguments.origin is None else load_imitator(arguments.origin)
    features = {} if known is None else feature_names(known)
    given = {
        name: getattr(arguments, name)
        for name in ("state", "environment_state", "action")
        if getattr(arguments, name) is not None
    }
    if given.get("environment_state") == "none":
        given["environment_state"] = None
    demonstrations = load_demonstrations(arguments.dataset, **{**features, **given})
    if known is not None:
        return known, demonstrations
    targets, lead = arguments.targets or _TARGETS, arguments.lead or _LEAD
    return Imitator.from_demonstrations(demonstrations, targets, lead), demonstrations


def _learn(
    imitator: Imitator, demonstrations: Demonstrations, corrections: bool
) -> list[EpisodeReport]:
    from pacnet.cli.progress import frames_of, progress_bar

    frames = frames_of(demonstrations)
    if imitator.forward_model is not None and not imitator.lessons:
        transitions = counted(frames - len(demonstrations), "transition")
        print(f"fitting the forward model to {transitions} ...", file=sys.stderr)
    with progress_bar("learning", frames) as advance:
        return imitator.learn(demonstrations, advance, corrections=corrections)


def _report(imitator: Imitator, lessons: list[EpisodeReport], seconds: float, folder: Path) -> None:
    print_lessons(lessons_of(imitator)[-len(lessons) :])
    print()
    frames, lengths = sum(lesson.frames for lesson in lessons), imitator.network.schemas.lengths
    learned = f"{counted(len(lessons), 'episode')}, {counted(frames, 'frame')} in {seconds:.1f} s"
    if len(imitator.lessons) > len(lessons):
        learned += f" ({counted(len(imitator.lessons), 'episode')} in all)"
    print_pairs(
        [
            ("learned", learned),
            ("nodes", f"{len(imitator.network.sofm):,}"),
            ("schemas", f"{len(lengths):,}"),
            ("targets", f"{int(lengths.sum()):,} {imitator.config.targets}s"),
            ("checkpoint", f"{folder}, {size_text(folder)}"),
        ]
    )
