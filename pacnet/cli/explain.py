"""`pacnet explain`: why an imitator would act as it does at one frame of a dataset."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from pacnet.cli.parsing import (
    Commands,
    add_checkpoint,
    add_command,
    add_dataset,
    add_json,
    whole_number,
)
from pacnet.cli.printing import print_json, print_pairs, print_table

_DETAILS = """The imitator runs over the episode from its start to the frame, as on the robot, since
earlier frames decide which behaviour the frame belongs to. The output has the winning node and its
neighbours, the motor schemas that compete there, the novelty, the target with the demonstrations
and frames it comes from, and the action."""
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
    add_json(parser)


def run(arguments: argparse.Namespace) -> None:
    """Explain one frame and print the result."""
    from pacnet.cli.explanation import explain
    from pacnet.cli.loading import load_imitator, load_percepts
    from pacnet.kernels.threads import use_one_thread

    use_one_thread()
    imitator = load_imitator(arguments.checkpoint)
    episode, several = arguments.episode, arguments.episodes
    arguments.episodes = [episode]  # the others are not read
    if several is not None and episode not in several:
        raise ValueError(f"expected --episode among --episodes, got {episode}")
    demonstrations = load_percepts(imitator, arguments)
    document = explain(imitator, demonstrations, episode, arguments.frame)
    if arguments.json:
        print_json(document)
    else:
        print_explanation(document)


def print_explanation(document: Mapping[str, Any]) -> None:
    """Print what `pacnet.cli.explanation.explain` returned."""
    print_pairs(_summary(document))
    if document["target"] is not None:
        _print_target(document)
        print("\nframes of demonstrations that the target stands for; its value is from the first")
        rows = [
            (row["dataset"], f"{row['episode']}", row["task"] or "untitled", f"{row['frame']}",
             f"{row['seconds']:.2f} s")
            for row in document["origins"]
        ]  # fmt: skip
        print_table(("<dataset", "episode", "<task", "frame", "time"), rows)
    if document["schemas"]:
        _print_schemas(document)
    _print_nodes(document)


def _summary(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    time = f"{document['frame']} ({document['seconds']:.2f} s)"
    episode = f"episode {document['episode']} of {document['dataset']}"
    threshold = f"{document['novelty_threshold']:g}"
    match = f"a match from {threshold}" if document["matches"] else f"below {threshold}, no match"
    pairs = [
        ("frame", f"{time} of {episode}, “{document['task'] or 'untitled'}”"),
        ("decision", f"{document['decision']}: {document['reason']}"),
        (
            "novelty",
            f"{document['novelty']:.2f} (novel above 1), largest in {document['dimension']}: "
            f"deviation {document['deviation']:+.3g}, threshold {document['threshold']:.3g}",
        ),
        (
            "winner",
            f"node {document['winner']}, activation {document['activation']:.2f} ({match})",
        ),
    ]
    if document["schema"] is not None:
        (won,) = [row for row in document["schemas"] if row["schema"] == document["schema"]]
        place = f"target {document['position'] + 1:,} of {won['targets']:,}"
        pairs.append(("schema", f"{document['schema']}, {place}"))
    return pairs


def _print_target(document: Mapping[str, Any]) -> None:
    """Print the action, and before it the target if that is a state."""
    target, action = document["target"], document["action"]
    if document["targets_are"] == "state":
        percept = document["percept"]
        rows = [(name, f"{percept[name]:.4g}", f"{value:.4g}") for name, value in target.items()]
        print("\ntarget: the state to reach")
        print_table(("<name", "now", "target"), rows)
    else:
        action = target
    if action is not None:
        print("\naction, not sent" if document["decision"] == "holds" else "\naction")
        print_table(("<name", "value"), [(name, f"{value:.4g}") for name, value in action.items()])


def _print_schemas(document: Mapping[str, Any]) -> None:
    rows, winner = document["schemas"], document["winner"]
    where = f"motor schemas of node {winner}"
    if any(row["node"] != winner for row in rows):
        where += ", none of them confident, and those of other nodes near the percept"
    print(f"\n{where}; * won")
    print_table(
        ("schema", "node", "confidence", "targets", "<shown in"),
        [
            (
                _starred(row["schema"], document["schema"]),
                f"{row['node']}",
                f"{row['confidence']:.1%}",
                f"{row['targets']:,}",
                ", ".join(name or "untitled" for name in row["behaviours"]),
            )
            for row in rows
        ],
    )
    if document["schema"] not in (None, rows[0]["schema"]):
        margin = f"{document['margin']:.1%}"
        print(f"* won before, and loses only to a schema that is more confident by {margin}")


def _print_nodes(document: Mapping[str, Any]) -> None:
    print(f"\nnearest nodes; {'* won' if document['matches'] else 'none matches'}")
    winner = document["winner"] if document["matches"] else None
    print_table(
        ("node", "activation", "distance", "schemas"),
        [
            (
                _starred(row["node"], winner),
                f"{row['activation']:.2f}",
                f"{row['distance']:.3f}",
                f"{row['schemas']}",
            )
            for row in document["nodes"]
        ],
    )


def _starred(number: int, winner: int | None) -> str:
    return f"* {number}" if number == winner else str(number)
