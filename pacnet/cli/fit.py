"""`pacnet fit`: learn the demonstrations of a dataset."""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

from pacnet.cli.cameras import add_cameras, cameras_of, describe_cameras
from pacnet.cli.fit_report import print_learned
from pacnet.cli.fit_usage import check_out, check_usage
from pacnet.cli.held_out import add_held_out, compare, to_learn
from pacnet.cli.parsing import (
    Commands,
    add_command,
    add_dataset,
    path,
    whole_number,
)
from pacnet.cli.points import (
    NONE,
    add_points,
    body_of,
    points_of,
)
from pacnet.cli.printing import counted, progress_bar

if TYPE_CHECKING:
    from pacnet.datasets.demonstrations import Demonstrations
    from pacnet.evaluation.held_out import Split
    from pacnet.forward_models.kinematics import KinematicModel
    from pacnet.imitator.imitator import Imitator

_DETAILS = """Every episode is learned once, in order; nothing is learned across a gap in time. A
percept is the state, followed by the environment state if the dataset has one, and by what cameras
tell of where the hand will be. All settings are chosen from the data."""
_EXAMPLES = """pacnet fit recordings/drinking --out imitator
  pacnet fit recordings/drinking --held-out 5 --out without_every_fifth
  pacnet fit recordings/toasting --from imitator --out imitator
  pacnet fit user/name --state arm --state hand --action actions --exclude 3 --out imitator
  pacnet fit pushing --out imitator --points 'hand=observation.state[0:2]' goal=observation.goal
  pacnet fit drinking --out imitator --body body --points glass=observation.environment_state[0:3]
  pacnet fit picking --out imitator --cameras top --points 'hand=observation.state[0:3]'
  pacnet fit recordings/corrections --corrections --from imitator --out imitator"""


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
        "--only-where", metavar="NAME",
        help="learn only the frames at which this feature is true, such as intervention: a "
        "correction without what the policy did before it",
    )  # fmt: skip
    _add_features(parser)
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
        "--budget", type=whole_number(1), metavar="N",
        help="keep the targets of N frames at most: keyframes, between which it interpolates; of "
        "what is shown again and again the last demonstrations (all frames)",
    )  # fmt: skip
    add_points(parser)
    add_cameras(parser)
    add_held_out(parser)
    parser.add_argument(
        "--overwrite", action="store_true",
        help="replace a checkpoint in DIR; not needed if --from is DIR too",
    )  # fmt: skip
    parser.set_defaults(usage_error=parser.error)


def _add_features(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which features are learned, and from which frames."""
    group = parser.add_argument_group(
        "which features of the dataset",
        "Give an option several times for several features, in the order given. With --from they "
        "are those of the imitator.",
    )
    group.add_argument(
        "--state", action="append", metavar="NAME",
        help="feature that is the robot's state; none to learn from the environment state alone "
        "(observation.state)",
    )  # fmt: skip
    group.add_argument(
        "--environment-state", action="append", metavar="NAME",
        help="feature that is the environment state; none to leave it out "
        "(observation.environment_state if the dataset has it)",
    )  # fmt: skip
    group.add_argument(
        "--action", action="append", metavar="NAME", help="feature that is the action (action)"
    )


def run(arguments: argparse.Namespace) -> None:
    """Learn, write the checkpoint and print what was learned."""
    check_usage(arguments)
    from pacnet.cli.loading import checkpoint_folder
    from pacnet.core.interrupts import defer_sigint
    from pacnet.kernels.threads import use_one_thread

    folder = checkpoint_folder(arguments.out)
    check_out(arguments, folder)
    use_one_thread()
    body = body_of(arguments)
    known, demonstrations = _load(arguments)
    parted = _parted(demonstrations, arguments.held_out)
    shown = to_learn(demonstrations, parted) if parted else demonstrations
    began = time.perf_counter()
    if known is None and arguments.targets == "state" and shown.state_features:
        _announce(shown)
    untrained = _untrained(arguments, body)
    imitator = untrained(shown) if known is None else known
    before = len(imitator.reports)
    _learn(imitator, shown, arguments.corrections)
    seconds = time.perf_counter() - began
    with defer_sigint():
        imitator.save_pretrained(folder)
    cameras = describe_cameras(imitator, shown if known is None else None)
    print_learned(imitator, before, seconds, folder, cameras)
    if parted:
        compare(parted, imitator, untrained)


def _load(arguments: argparse.Namespace) -> tuple[Imitator | None, Demonstrations]:
    """Return the imitator to continue from, if any, and the demonstrations."""
    from pacnet.cli.loading import load_dataset, load_imitator
    from pacnet.datasets.format import DatasetWarning
    from pacnet.datasets.pictures.decoders import MissingDecoder

    imitator = None if arguments.origin is None else load_imitator(arguments.origin)
    features = {}
    for name in ("state", "environment_state", "action"):
        given = getattr(arguments, name)
        if given is not None:
            features[name] = () if given == [NONE] and name != "action" else tuple(given)
    options = {"only_where": arguments.only_where, **features}
    try:
        cameras = cameras_of(arguments, imitator)
        return imitator, load_dataset(arguments, imitator, cameras=cameras, **options)
    except MissingDecoder as error:
        if imitator is not None or arguments.cameras is not None:
            raise
        warnings.warn(f"no camera is looked at: {error}", DatasetWarning, stacklevel=1)
        return imitator, load_dataset(arguments, imitator, **options)


def _parted(demonstrations: Demonstrations, every: int | None) -> list[Split]:
    """Return what to learn and what to hold out; nothing if nothing is to be held out."""
    if every is None:
        return []
    from pacnet.evaluation.held_out import splits

    return splits(demonstrations, every)


def _untrained(
    arguments: argparse.Namespace, body: KinematicModel | None
) -> Callable[[Demonstrations], Imitator]:
    """Return what makes an imitator with settings from demonstrations, as the arguments say."""
    from pacnet.imitator.imitator import Imitator

    targets, lead = arguments.targets or "action", arguments.lead or 1
    return lambda demonstrations: Imitator.from_demonstrations(
        demonstrations,
        targets,
        lead,
        budget=arguments.budget,
        points=points_of(arguments),
        body=body,
        encoder=arguments.encoder or "auto",
    )


def _announce(demonstrations: Demonstrations) -> None:
    """Say what may take seconds."""
    frames = sum(len(shown.state) for shown in demonstrations)
    transitions = counted(frames - len(demonstrations.continuous()), "transition")
    print(f"fitting the forward model to {transitions} ...", file=sys.stderr)


def _learn(imitator: Imitator, demonstrations: Demonstrations, corrections: bool) -> None:
    """Learn, with a progress bar."""
    frames = sum(len(shown.state) for shown in demonstrations)
    with progress_bar("learning", frames) as advance:
        imitator.learn(demonstrations, advance, corrections=corrections)
