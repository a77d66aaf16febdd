"""The explanation of one frame as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pacnet.cli.printing import print_pairs, print_table


def print_explanation(document: Mapping[str, Any]) -> None:
    """Prints what `pacnet.cli.explanation.explain` gave."""
    print_pairs(_summary(document))
    if document["target"] is not None:
        _print_values(document)
        print("\nthe target is from the first of these frames; about at the others it came again")
        print_table(
            ("<dataset", "episode", "<task", "frame", "time"),
            [
                (row["dataset"], f"{row['episode']}", row["task"] or "untitled",
                 f"{row['frame']}", f"{row['seconds']:.2f} s")
                for row in document["origins"]
            ],
        )  # fmt: skip
    if document["schemas"]:
        _print_schemas(document)
    _print_nodes(document)


def _summary(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    at = f"{document['frame']} ({document['seconds']:.2f} s)"
    task = document["task"] or "untitled"
    only = "" if document["matches"] else "only "
    pairs = [
        ("frame", f"{at} of episode {document['episode']} of {document['dataset']}, “{task}”"),
        ("does", f"{document['does']}: {document['because']}"),
        (
            "novelty",
            f"{document['novelty']:.2f} (new over 1), largest in {document['dimension']}: "
            f"{document['deviation']:+.3g}, {document['tolerated']:.3g} is tolerated",
        ),
        (
            "winner",
            f"node {document['winner']}, activation {document['activation']:.2f} "
            f"({only}a match from {document['matches_from']:g})",
        ),
    ]
    if document["schema"] is not None:
        number, length = document["position"] + 1, _won(document)["targets"]
        pairs.append(("schema", f"{document['schema']}, target {number:,} of {length:,}"))
    return pairs


def _won(document: Mapping[str, Any]) -> Mapping[str, Any]:
    (own,) = [row for row in document["schemas"] if row["schema"] == document["schema"]]
    return own


def _print_values(document: Mapping[str, Any]) -> None:
    """The target and the action, which are one where targets are actions."""
    held = ", which is held back" if document["does"] == "holds" else ""
    if document["targets_are"] == "state":
        percept = document["percept"]
        print("\ntarget: the state to reach")
        print_table(
            ("<name", "now", "target"),
            [
                (name, f"{percept[name]:.4g}", f"{value:.4g}")
                for name, value in document["target"].items()
            ],
        )
    action = document["target"] if document["targets_are"] == "action" else document["action"]
    if action is not None:
        print(f"\naction{held}")
        print_table(("<name", "value"), [(name, f"{value:.4g}") for name, value in action.items()])


def _print_schemas(document: Mapping[str, Any]) -> None:
    where = f"motor schemas of node {document['winner']}"
    if any(row["node"] != document["winner"] for row in document["schemas"]):
        where += ", none of them confident, and those of other nodes that know the percept"
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
            for row in document["schemas"]
        ],
    )
    first = document["schemas"][0]["schema"]
    if document["schema"] not in (None, first):
        margin = f"{document['margin']:.1%}"
        print(f"* had won before, and is given up only for one more confident by {margin}")


def _print_nodes(document: Mapping[str, Any]) -> None:
    print(f"\nnearest nodes; {'* won' if document['matches'] else 'none is near enough'}")
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
