"""`pacnet info`: what a checkpoint is, and from what it was learned."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pacnet.cli.parsing import Commands, add_command
from pacnet.cli.printing import (
    NOTHING,
    counted,
    print_json,
    print_pairs,
    print_table,
    size_of,
    size_text,
)

if TYPE_CHECKING:
    from pacnet.imitator.imitator import Imitator
    from pacnet.network.network import PACNet

_MORE = """Of an imitator: the demonstrations that it was learned from, the names and the scale of
what it perceives, what it does, and how much it remembers. Checkpoints of a bare network or
forward model are told about too."""
_EXAMPLE = """pacnet info imitator
  pacnet info imitator --json | jq .nodes"""


def add_to(commands: Commands) -> None:
    """Adds the command to the main parser."""
    summary = "what a checkpoint is, and from what it was learned"
    parser = add_command(commands, "info", summary, _MORE, _EXAMPLE, run)
    parser.add_argument(
        "checkpoint", metavar="CHECKPOINT",
        help="folder of a checkpoint, or of a LeRobot policy of type pacnet",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON, for machines")


def run(arguments: argparse.Namespace) -> None:
    """Describes the checkpoint and prints it."""
    document = describe(arguments.checkpoint)
    if arguments.json:
        print_json(document)
    else:
        _print(document)


def describe(checkpoint: str) -> dict[str, Any]:
    """What there is to say about a checkpoint, as JSON holds it."""
    from pacnet.cli.sources import checkpoint_folder, kind_of, load_imitator
    from pacnet.core.checkpoint import read_checkpoint
    from pacnet.network.network import PACNet

    folder = checkpoint_folder(checkpoint)
    kind = kind_of(folder)
    document: dict[str, Any] = {"kind": kind, "folder": str(folder), "bytes": size_of(folder)}
    if kind == "Imitator":
        return document | _of_imitator(load_imitator(folder))
    if kind == "PACNet":
        network = PACNet.from_pretrained(folder)
        scale = network.sofm.scale.tolist()
        return document | _of_network(network) | {"percept": {"percept": _unnamed(scale)}}
    fields, tensors = read_checkpoint(folder)
    settings = {name: value for name, value in fields.items() if name != "model"}
    numbers = sum(tensor.numel() for tensor in tensors.values())
    return document | {"numbers": numbers, "settings": settings}


def _of_imitator(imitator: Imitator) -> dict[str, Any]:
    from pacnet.cli.lessons import lessons_of

    config = imitator.config
    scale = iter(imitator.network.sofm.scale.tolist())
    return {
        "fps": config.fps,
        "targets_are": config.targets,
        "lead": config.lead if config.targets == "state" else None,
        **_of_network(imitator.network),
        "percept": {
            feature: dict(zip(names, scale, strict=False))
            for feature, names in config.percepts.items()
        },
        "action": list(config.action),
        "first_action": imitator.first_action.tolist(),
        "lessons": lessons_of(imitator),
    }


def _of_network(network: PACNet) -> dict[str, Any]:
    lengths = network.schemas.lengths
    return {
        "nodes": len(network.sofm),
        "schemas": int((lengths > 0).sum()),
        "targets": int(lengths.sum()),
        "target_dimensions": network.config.schemas.target_dimensions,
        "behaviours": list(network.behaviours),
    }


def _unnamed(scale: Sequence[float]) -> dict[str, float]:
    return {str(place): factor for place, factor in enumerate(scale)}


def _print(document: Mapping[str, Any]) -> None:
    folder = document["folder"]
    pairs = [("checkpoint", f"{folder}: {document['kind']}, {size_text(folder)}")]
    if "percept" not in document:
        told = [(name, _shortly(value)) for name, value in document["settings"].items()]
        print_pairs([*pairs, ("numbers", f"{document['numbers']:,}"), *told])
        return
    print_pairs([*pairs, *_summary(document)])
    _print_percept(document["percept"])
    if document.get("lessons"):
        from pacnet.cli.lessons import print_lessons

        print("\nlearned from")
        print_lessons(document["lessons"])


def _summary(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    dimensions = sum(map(len, document["percept"].values()))
    rate = f" at {document['fps']:g} frames per second" if "fps" in document else ""
    pairs = [("percept", f"{counted(dimensions, 'dimension')}{rate}")]
    if "action" in document:
        pairs.append(("action", ", ".join(document["action"])))
    behaviours = [name or "untitled" for name in document["behaviours"]]
    return [
        *pairs,
        ("nodes", f"{document['nodes']:,}"),
        ("schemas", f"{document['schemas']:,}"),
        ("targets", f"{document['targets']:,}{_kind_of_targets(document)}"),
        ("behaviours", ", ".join(behaviours) or NOTHING),
    ]


def _kind_of_targets(document: Mapping[str, Any]) -> str:
    of = f" of {counted(document['target_dimensions'], 'dimension')}"
    if "targets_are" not in document:
        return of
    if document["targets_are"] == "action":
        return f" actions{of}"
    return f" states{of}, {counted(document['lead'], 'frame')} ahead; a forward model acts"


def _print_percept(percept: Mapping[str, Mapping[str, float]]) -> None:
    print("\npercept, and the factor on each dimension before distances are taken")
    rows = [
        (feature, name, f"{factor:.4g}")
        for feature, names in percept.items() for name, factor in names.items()
    ]  # fmt: skip
    print_table(("<feature", "<dimension", "scale"), rows)


def _shortly(value: Any) -> str:
    """A setting in a few words: long lists by their length."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_shortly(part)}" for name, part in value.items())
    if isinstance(value, list):
        parts = ", ".join(map(_shortly, value))
        return parts if len(parts) <= 40 else f"{len(value)} values"
    return NOTHING if value is None else str(value)
