"""`pacnet info`: what a checkpoint contains, and from which demonstrations it was learned."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from pacnet.cli.cameras import camera_pairs, describe_cameras
from pacnet.cli.cuts import cut_pairs, describe_cuts
from pacnet.cli.parsing import Commands, add_checkpoint, add_command, add_json
from pacnet.cli.points import body_text, describe_joints, describe_points, points_text
from pacnet.cli.printing import (
    NOTHING,
    counted,
    print_json,
    print_pairs,
    print_table,
    size_text,
)
from pacnet.cli.reports import (
    describe_forward_model,
    describe_reports,
    forward_model_text,
    print_reports,
)

if TYPE_CHECKING:
    from pacnet.imitator.imitator import Imitator
    from pacnet.network.network import PACNet

_DETAILS = """For an imitator: the names, scale and novelty thresholds of its percepts, its actions,
how much it has stored, and the demonstrations it learned. Checkpoints of a bare network or forward
model are described too."""
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
    from pacnet.forward_models.kinematics import KinematicModel
    from pacnet.network.network import PACNet

    folder = existing_checkpoint(checkpoint)
    kind = kind_of(folder)
    document: dict[str, Any] = {"kind": kind, "folder": str(folder), "bytes": size_of(folder)}
    if kind == "Imitator":
        return document | _describe_imitator(load_imitator(folder))
    if kind == "PACNet":
        return document | _describe_network(PACNet.from_pretrained(folder))
    if kind == "KinematicModel":
        document["body"] = describe_joints(KinematicModel.from_pretrained(folder).config)
    fields, tensors = read_checkpoint(folder)
    document["numbers"] = sum(tensor.numel() for tensor in tensors.values())
    document["settings"] = {name: field for name, field in fields.items() if name != "model"}
    return document


def _describe_imitator(imitator: Imitator) -> dict[str, Any]:
    config, memory = imitator.config, imitator.memory
    scale = config.scaling.scale
    thresholds = imitator.novelty_detector.thresholds.double().numpy() / scale
    judged = len(memory) > 0 and imitator.frames is None  # by each dimension for itself
    return {
        "fps": config.fps,
        "nodes": len(imitator.sofm),
        "demonstrations": len(memory),
        "tasks": list(imitator.tasks),
        "targets": len(memory.rows),
        "targets_shown": sum(report.frames for report in imitator.reports),
        "targets_are": config.targets,
        "target_dimensions": config.target_dimensions,
        "lead": config.lead if config.targets == "state" else None,
        "forward_model": describe_forward_model(imitator),
        "budget": config.budget,
        "percept": _by_feature(config.percepts, scale),
        "thresholds": _by_feature(config.percepts, thresholds.tolist()) if judged else None,
        "action": list(config.action),
        "positions": _positions(imitator),
        "positions_lead": config.follows_after if config.targets == "action" else None,
        "cameras": describe_cameras(imitator),
        **describe_points(config),
        **describe_cuts(imitator),
        "first_action": imitator.first_action.tolist(),
        "reports": describe_reports(imitator),
    }


def _positions(imitator: Imitator) -> dict[str, str]:
    """Return which actions are position targets: name -> name of the dimension that follows."""
    config = imitator.config
    if config.targets == "state":
        return {}
    pairs = zip(config.action, config.follows, strict=True)
    return {name: imitator.percept_names[number] for name, number in pairs if number >= 0}


def _describe_network(network: PACNet) -> dict[str, Any]:
    lengths, scale = network.schemas.lengths, network.sofm.scale.tolist()
    return {
        "nodes": len(network.sofm),
        "schemas": int((lengths > 0).sum()),
        "targets": int(lengths.sum()),
        "target_dimensions": network.config.schemas.target_dimensions,
        "behaviours": list(network.behaviours),
        "percept": _by_feature({"percept": map(str, range(len(scale)))}, scale),
    }


def _by_feature(
    names: Mapping[str, Iterable[str]], values: Iterable[float]
) -> dict[str, dict[str, float]]:
    """Return the value of each dimension of a percept, by feature and name."""
    left = iter(values)
    return {
        feature: {name: next(left) for name in dimensions} for feature, dimensions in names.items()
    }


def _print(document: Mapping[str, Any]) -> None:
    pairs = [
        ("checkpoint", f"{document['folder']}: {document['kind']}, {size_text(document['bytes'])}")
    ]
    if "percept" not in document:
        body = document.get("body")
        settings = [(name, _brief(value)) for name, value in document["settings"].items()]
        if body is not None:
            settings = [("body", body_text(body))]
        print_pairs([*pairs, ("numbers", f"{document['numbers']:,}"), *settings])
        return
    is_imitator = "fps" in document
    print_pairs([*pairs, *(_imitator if is_imitator else _network)(document)])
    _print_percept(document)
    if document.get("reports"):
        print("\nlearned from")
        print_reports(document["reports"])


def _imitator(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    percept = counted(sum(map(len, document["percept"].values())), "dimension")
    shown, budget = document["targets_shown"], document["budget"]
    kind = f"{document['targets_are']}s of {counted(document['target_dimensions'], 'dimension')}"
    if document["lead"] is not None:
        kind += f", {counted(document['lead'], 'frame')} ahead"
    pairs = [
        ("percept", f"{percept} at {document['fps']:g} frames per second"),
        ("action", ", ".join(document["action"])),
        ("points", points_text(document)),
        *camera_pairs(document),
        *cut_pairs(document),
        ("nodes", f"{document['nodes']:,}"),
        ("demonstrations", f"{document['demonstrations']:,}"),
        ("targets", f"{document['targets']:,} of {shown:,} shown, {kind}"),
        ("budget", "none, all are kept" if budget is None else f"{budget:,} targets at most"),
        ("tasks", ", ".join(name or "untitled" for name in document["tasks"]) or NOTHING),
    ]
    if document["forward_model"] is not None:
        pairs.append(("forward model", forward_model_text(document["forward_model"])))
    if document["body"] is not None:
        pairs.insert(3, ("body", body_text(document["body"])))
    if document["positions_lead"] is not None:
        pairs.insert(2, ("positions", _position_targets(document)))
    return pairs


def _position_targets(document: Mapping[str, Any]) -> str:
    """Return which actions are places of the state, and by how much they lie ahead of it."""
    places, lead = document["positions"], document["positions_lead"]
    if not places:
        return "no action is a position target"
    names = (name if name == of else f"{name} (of {of})" for name, of in places.items())
    which = "every action" if len(places) == len(document["action"]) else ", ".join(names)
    ahead = f"{counted(lead, 'frame')} ({lead / document['fps']:.2f} s) ahead of the state"
    return f"{which}, {ahead}"


def _network(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    percept = counted(sum(map(len, document["percept"].values())), "dimension")
    dimensions = counted(document["target_dimensions"], "dimension")
    return [
        ("percept", percept),
        ("nodes", f"{document['nodes']:,}"),
        ("schemas", f"{document['schemas']:,}"),
        ("targets", f"{document['targets']:,} of {dimensions}"),
        ("behaviours", ", ".join(name or "untitled" for name in document["behaviours"]) or NOTHING),
    ]


def _print_percept(document: Mapping[str, Any]) -> None:
    """Print the dimensions of a percept, with scales and thresholds."""
    thresholds = document.get("thresholds")
    about = "" if thresholds is None else "; deviation above which it is novel, in its own unit"
    print(f"\npercept: factor on each dimension in distances{about}")
    rows = [
        (feature, name, f"{factor:.4g}")
        for feature, names in document["percept"].items() for name, factor in names.items()
    ]  # fmt: skip
    if thresholds is None:
        print_table(("<feature", "<dimension", "scale"), rows)
        return
    above = [f"{value:.3g}" for names in thresholds.values() for value in names.values()]
    table = [(*row, value) for row, value in zip(rows, above, strict=True)]
    print_table(("<feature", "<dimension", "scale", "novel above"), table)


def _brief(value: Any) -> str:
    """Return a setting in a few words: of long lists their length."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_brief(part)}" for name, part in value.items())
    if isinstance(value, list):
        parts = ", ".join(map(_brief, value))
        return parts if len(parts) <= 40 else f"{len(value)} values"
    return NOTHING if value is None else str(value)
