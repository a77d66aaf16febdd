"""`pacnet explain`: why an imitator would act as it does at one frame of a dataset."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pacnet.cli.cameras import short_name
from pacnet.cli.parsing import (
    Commands,
    add_checkpoint,
    add_command,
    add_dataset,
    add_json,
    add_task,
    check_folder,
    path,
    whole_number,
)
from pacnet.cli.printing import NOTHING, print_json, print_pairs, print_table

if TYPE_CHECKING:
    from pacnet.imitator.imitator import Imitator

_DETAILS = """The imitator runs over the episode from its start to the frame, as on the robot, since
earlier frames decide which demonstrations it follows, and where in each of them it is. The output
has these demonstrations with their moments and weights, the novelty, the progress, and the action
beside the actions that were shown at these moments. With points it follows one demonstration, and
the output names the segment of it and the landmark in whose frame its targets are kept. With
cameras it says how unlike what was shown their pictures are."""
_EXAMPLE = "pacnet explain imitator recordings/new --episode 0 --frame 120"


def add_to(commands: Commands) -> None:
    """Add the command to the main parser."""
    summary = "show why an imitator acts or holds at one frame, and from which demonstrations"
    parser = add_command(commands, "explain", summary, _DETAILS, _EXAMPLE, run)
    add_checkpoint(parser)
    add_dataset(
        parser, "As for the other commands; only --episode is read, which must be among them."
    )
    parser.add_argument(
        "--episode", type=whole_number(0), required=True, metavar="E",
        help="number of the episode in the dataset",
    )  # fmt: skip
    parser.add_argument(
        "--frame", type=whole_number(0), required=True, metavar="F",
        help="frame of the episode, counted from 0",
    )  # fmt: skip
    add_task(parser)
    parser.add_argument(
        "--out", type=path, metavar="DIR",
        help="with cameras: draw the frame beside the remembered picture of what is followed, with "
        "boxes around what is attended to, to DIR/episode_NNN_frame_NNNN.png",
    )  # fmt: skip
    add_json(parser)


def run(arguments: argparse.Namespace) -> None:
    """Explain one frame and print the result."""
    from pacnet.cli.explanation import explain
    from pacnet.cli.loading import load_imitator, load_percepts
    from pacnet.kernels.threads import use_one_thread

    use_one_thread()
    imitator = load_imitator(arguments.checkpoint, arguments.task)
    episode, several = arguments.episode, arguments.episodes
    arguments.episodes = [episode]  # the others are not read
    if several is not None and episode not in several:
        raise ValueError(f"expected --episode among --episodes, got {episode}")
    demonstrations = load_percepts(imitator, arguments)
    picture = _picture(imitator, arguments)
    document = explain(imitator, demonstrations, episode, arguments.frame, arguments.task, picture)
    if arguments.json:
        print_json(document)
        return
    print_explanation(document)
    if picture is not None:
        print()
        print_pairs([("picture", str(picture))])


def _picture(imitator: Imitator, arguments: argparse.Namespace) -> Path | None:
    """Return the file to draw to, if that was asked for, after making its folder."""
    if arguments.out is None:
        return None
    if imitator.cameras is None:
        raise ValueError("expected --out with an imitator that looks at cameras, it has none")
    check_folder("--out", arguments.out)
    Path(arguments.out).mkdir(parents=True, exist_ok=True)
    return Path(arguments.out) / f"episode_{arguments.episode:03}_frame_{arguments.frame:04}.png"


def print_explanation(document: Mapping[str, Any]) -> None:
    """Print what `pacnet.cli.explanation.explain` returned."""
    print_pairs(_summary(document))
    if document["followed"]:
        _print_target(document)
        _print_followed(document)
    print("\npercept")
    rows = [(name, f"{value:.4g}") for name, value in document["percept"].items()]
    print_table(("<dimension", "value"), rows)


def _summary(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    time = f"{document['frame']} ({document['seconds']:.2f} s)"
    episode = f"episode {document['episode']} of {document['dataset']}"
    threshold = f"{document['novelty_threshold']:g}"
    match = f"a match from {threshold}" if document["matches"] else f"below {threshold}, no match"
    task = document["asked_for"]
    only = f"only what was shown for “{task or 'untitled'}”"
    follows = "whatever fits" if task is None else only
    segment = document["segment"]
    done = ", at the end of what is followed most" if document["is_done"] else ""
    return [
        ("frame", f"{time} of {episode}, “{document['task'] or 'untitled'}”"),
        ("decision", f"{document['decision']}: {document['reason']}"),
        ("follows", follows),
        *([] if segment is None else _segment_pairs(segment)),
        *_camera_pairs(document["cameras"]),
        ("progress", f"{document['progress']:.1%}{done}"),
        (
            "novelty",
            f"{document['novelty']:.2f} (novel above 1), largest in {document['dimension']}: "
            f"deviation {document['deviation']:+.3g}, threshold {document['threshold']:.3g}",
        ),
        (
            "winner",
            f"node {document['winner']} of the map, activation {document['activation']:.2f} "
            f"({match})",
        ),
    ]


def _camera_pairs(cameras: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return what each camera sees, in words."""
    texts = [
        f"{short_name(one['feature'])}: doubt {one['doubt']:.2f} (new above 1), last looked at "
        f"{one['looked_at']:.2f} s; {_remembered(one['remembered'])}"
        for one in cameras
    ]
    return [("cameras" if number == 0 else "", text) for number, text in enumerate(texts)]


def _remembered(beginning: Mapping[str, Any] | None) -> str:
    """Return in words which picture is remembered."""
    if beginning is None:
        return "no picture is remembered"
    return f"as episode {beginning['episode']} of {beginning['dataset']} began"


def _segment_pairs(segment: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return where the demonstration that is followed goes now, in words."""
    from pacnet.imitator.cuts import WORLD_NAME

    landmark, reference, moved = segment["landmark"], segment["reference"], segment["moved"]
    way = "to no landmark" if landmark == WORLD_NAME else f"on the way to {landmark}"
    kept = f"in the frame of {reference}"
    if segment["distance"] is not None:
        kept += (
            f": {moved} is {segment['distance']:.4g} from it now, and was "
            f"{segment['distance_shown']:.4g} from it at the moment followed"
        )
    return [
        ("segment", f"{segment['number']} of {segment['of']}, {way}"),
        ("targets", kept),
    ]


def _print_target(document: Mapping[str, Any]) -> None:
    """Print the action, and before it the target if that is a state."""
    target, action, shown = document["target"], document["action"], _mean_shown(document)
    if document["targets_are"] == "state":
        percept = document["percept"]
        rows = [
            (
                name,
                f"{percept[name]:.4g}" if name in percept else NOTHING,
                f"{value:.4g}",
                f"{shown[name]:.4g}",
            )
            for name, value in target.items()
        ]
        print("\ntarget: the state to reach")
        print_table(("<name", "now", "target", "shown"), rows)
    else:
        rows = [(name, f"{value:.4g}", f"{shown[name]:.4g}") for name, value in target.items()]
        print("\naction, not sent" if action is None else "\naction")
        print_table(("<name", "value", "shown"), rows)
    print(_about_shown(document["segment"]))
    if document["targets_are"] == "state" and action is not None:
        print("\naction")
        print_table(("<name", "value"), [(name, f"{value:.4g}") for name, value in action.items()])


def _about_shown(segment: Mapping[str, Any] | None) -> str:
    """Return how an action comes from what was shown."""
    if segment is None:
        return "shown: the weighted mean below; the rest corrects for the deviation from it"
    moved = segment["moved"]
    if not segment["of_body"]:
        return (
            "shown: at the moment below; the value is turned as the landmark is, and corrects for "
            f"what {moved} is off"
        )
    return (
        f"shown: at the moment below; the value has the angles near these that take {moved}, or "
        f"what it carries, to where it was then, seen from {segment['reference']}"
    )


def _mean_shown(document: Mapping[str, Any]) -> dict[str, float]:
    """Return the weighted mean of the targets that were shown at the moments followed."""
    return {
        name: sum(one["weight"] * one["target"][name] for one in document["followed"])
        for name in document["target"]
    }


def _print_followed(document: Mapping[str, Any]) -> None:
    followed, segment = document["followed"], document["segment"]
    if segment is None:
        print("\ndemonstrations that are followed, and the moment of each that is now")
    else:
        print("\ndemonstration that is followed, and the moment of it that is now")
    rows = [
        (one["dataset"], f"{one['episode']}", one["task"] or "untitled", f"{one['frame']}",
         f"{one['seconds']:.2f} s", f"{one['weight']:.1%}", f"{one['deviation']:+.3g}",
         one["dimension"])
        for one in followed
    ]  # fmt: skip
    heads = ("<dataset", "episode", "<task", "frame", "time", "weight", "deviation", "<in")
    print_table(heads, rows)
    if segment is None:
        print(
            "deviation, in: of the percept from that moment, where it is largest for its threshold"
        )
    else:
        print(
            f"deviation, in: of {segment['moved']} from its place at that moment, both seen from "
            f"{segment['reference']}, where it is largest;\nit fades along the way where it was "
            "there at the beginning of the segment"
        )
