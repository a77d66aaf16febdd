"""`pacnet info`: what a checkpoint contains, and from which demonstrations it was learned."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from pacnet.cli.parsing import Commands, add_checkpoint, add_command, add_json
from pacnet.cli.printing import (
    NOTHING,
    counted,
    print_json,
    print_pairs,
    print_table,
    size_text,
)
from pacnet.cli.reports import describe_reports, print_reports

_DETAILS = """For an imitator: the names and the scale of its percepts, its actions, how much it has
stored, and the demonstrations it learned. Checkpoints of a bare network or forward model are
described too."""
_EXAMPLE = """pacnet info imitator
  pacnet info imitator --json | jq .nodes"""


def add_to(commands: Commands) -> None:
    """Add the command to the main parser."""
    summary = "describe a checkpoint, and the demonstrations it was learned from"
    parser = add_command(commands, "info", summary, _DETAILS, _EXAMPLE, run)
    add_checkpoint(parser)
    add_json(parser)


def run(arguments: argparse.Namespace) -> None:
    """Describe the checkpoint and print the result."""
    document = describe(arguments.checkpoint)
    if arguments.json:
        print_json(document)
    else:
        _print(document)


def describe(checkpoint: str) -> dict[str, Any]:
    """Return a description of a checkpoint, for JSON."""
    from pacnet.cli.loading import existing_checkpoint, kind_of, load_imitator, size_of
    from pacnet.core.checkpoint import read_checkpoint
    from pacnet.network.network import PACNet

    folder = existing_checkpoint(checkpoint)
    kind = kind_of(folder)
    document: dict[str, Any] = {"kind": kind, "folder": str(folder), "bytes": size_of(folder)}
    if kind == "Imitator":
        imitator = load_imitator(folder)
        config = imitator.config
        document |= {
            "fps": config.fps,
            "targets_are": config.targets,
            "lead": config.lead if config.targets == "state" else None,
            **_describe_network(imitator.network, config.percepts),
            "action": list(config.action),
            "first_action": imitator.first_action.tolist(),
            "reports": describe_reports(imitator),
        }
    elif kind == "PACNet":
        network = PACNet.from_pretrained(folder)
        numbers = tuple(map(str, range(len(network.sofm.scale))))
        document |= _describe_network(network, {"percept": numbers})
    else:
        fields, tensors = read_checkpoint(folder)
        document["numbers"] = sum(tensor.numel() for tensor in tensors.values())
        document["settings"] = {name: field for name, field in fields.items() if name != "model"}
    return document


def _describe_network(network: Any, percept: Mapping[str, tuple[str, ...]]) -> dict[str, Any]:
    """Return how much a `PACNet` has stored, and the scale of its percept by feature and name."""
    lengths, scale = network.schemas.lengths, iter(network.sofm.scale.tolist())
    return {
        "nodes": len(network.sofm),
        "schemas": int((lengths > 0).sum()),
        "targets": int(lengths.sum()),
        "target_dimensions": network.config.schemas.target_dimensions,
        "behaviours": list(network.behaviours),
        "percept": {
            feature: dict(zip(names, scale, strict=False)) for feature, names in percept.items()
        },
    }


def _print(document: Mapping[str, Any]) -> None:
    pairs = [
        ("checkpoint", f"{document['folder']}: {document['kind']}, {size_text(document['bytes'])}")
    ]
    if "percept" not in document:
        settings = [(name, _brief(value)) for name, value in document["settings"].items()]
        print_pairs([*pairs, ("numbers", f"{document['numbers']:,}"), *settings])
        return
    print_pairs([*pairs, *_summary(document)])
    print("\npercept, and the factor on each dimension in distances")
    rows = [
        (feature, name, f"{factor:.4g}")
        for feature, names in document["percept"].items() for name, factor in names.items()
    ]  # fmt: skip
    print_table(("<feature", "<dimension", "scale"), rows)
    if document.get("reports"):
        print("\nlearned from")
        print_reports(document["reports"])


def _summary(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    percept = counted(sum(map(len, document["percept"].values())), "dimension")
    kind = f"of {counted(document['target_dimensions'], 'dimension')}"
    if "fps" in document:
        percept += f" at {document['fps']:g} frames per second"
        kind = f"{document['targets_are']}s {kind}"
    if document.get("lead") is not None:
        kind += f", {counted(document['lead'], 'frame')} ahead; a forward model finds the actions"
    action = [("action", ", ".join(document["action"]))] if "action" in document else []
    behaviours = ", ".join(name or "untitled" for name in document["behaviours"])
    return [
        ("percept", percept),
        *action,
        ("nodes", f"{document['nodes']:,}"),
        ("schemas", f"{document['schemas']:,}"),
        ("targets", f"{document['targets']:,} {kind}"),
        ("behaviours", behaviours or NOTHING),
    ]


def _brief(value: Any) -> str:
    """Return a setting in a few words: of long lists their length."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_brief(part)}" for name, part in value.items())
    if isinstance(value, list):
        parts = ", ".join(map(_brief, value))
        return parts if len(parts) <= 40 else f"{len(value)} values"
    return NOTHING if value is None else str(value)
