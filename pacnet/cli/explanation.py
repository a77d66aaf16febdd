"""Why an imitator acts or holds at one frame, as a document for JSON."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from pacnet.cli.replay import reason_of
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import ImitatorStep

_NODES = 5  # the nearest ones are listed


def explain(
    imitator: Imitator, demonstrations: Demonstrations, episode: int, frame: int
) -> dict[str, Any]:
    """Run over the episode from its start to the frame, and return what decided there.

    Args:
        imitator: starts a new recall episode.
        demonstrations: of the imitator's features.
        episode: number of the episode in its dataset.
        frame: of the episode, from 0.

    Raises:
        ValueError: no such episode or frame.
    """
    shown = _find(demonstrations, episode, frame)
    imitator.reset()
    percepts = shown.percepts[: frame + 1]
    step = [imitator.step(percept) for percept in percepts.numpy()][-1]
    decision, config, percept = step.decision, imitator.config, percepts[-1]
    state = imitator.percept_names[: config.state_dimensions]
    return {
        "dataset": demonstrations.source,
        "episode": episode,
        "task": shown.task,
        "frame": frame,
        "seconds": frame / demonstrations.fps,
        "decision": "acts" if step.action is not None else "holds",
        "reason": reason_of(step).sentence,
        "novelty": step.novelty,
        "is_novel": step.is_novel,
        "dimension": step.dimension,
        "deviation": step.deviation,
        "threshold": step.threshold,
        "percept": _named(imitator.percept_names, percept),
        "winner": decision.winner,
        "activation": decision.activation,
        "matches": not decision.is_novel,
        "novelty_threshold": config.network.attention.novelty_threshold,
        "schema": decision.schema if decision.has_target else None,
        "position": decision.offset if decision.has_target else None,
        "targets_are": config.targets,
        "target": _named(config.action if config.targets == "action" else state, decision.target),
        "action": _named(config.action, step.action),
        "origins": _origins(imitator, step) if decision.has_target else [],
        "margin": imitator.schemas.config.margin,
        "schemas": _rivals(imitator, step, percept),
        "nodes": _nodes(imitator, percept),
    }


def _find(demonstrations: Demonstrations, episode: int, frame: int) -> Demonstration:
    numbers = [shown.episode for shown in demonstrations]
    if episode not in numbers:
        raise ValueError(
            f"expected an episode of {demonstrations.source}, {numbers[0]} to {numbers[-1]}, "
            f"got {episode}"
        )
    shown = demonstrations.episodes[numbers.index(episode)]
    if frame >= len(shown.state):
        raise ValueError(
            f"expected a frame of episode {episode}, 0 to {len(shown.state) - 1}, got {frame}"
        )
    return shown


def _named(names: tuple[str, ...], values: Any) -> dict[str, float] | None:
    return None if values is None else dict(zip(names, values.tolist(), strict=True))


def _origins(imitator: Imitator, step: ImitatorStep) -> list[dict[str, Any]]:
    """Return the frames of demonstrations that the target stands for."""
    origins = imitator.schemas.origins(step.decision.schema, step.decision.offset)
    reports = [imitator.reports[origin.episode] for origin in origins]
    return [
        {
            "dataset": report.dataset,
            "episode": report.episode,
            "task": report.task,
            "frame": report.first_frame + origin.frame,
            "seconds": (report.first_frame + origin.frame) / imitator.config.fps,
        }
        for report, origin in zip(reports, origins, strict=True)
    ]


def _rivals(imitator: Imitator, step: ImitatorStep, percept: Tensor) -> list[dict[str, Any]]:
    """Return the schemas that competed, of other nodes too if none of the winner's is confident."""
    schemas = imitator.schemas
    if step.decision.is_novel or schemas.timeline() is None:
        return []
    scaled = imitator.network.sofm.normalize(percept[None])[0]
    return [
        {
            "schema": rival.schema,
            "node": rival.node,
            "confidence": rival.confidence,
            "behaviours": list(rival.behaviours),
            "targets": int(schemas.lengths[rival.schema]),
        }
        for rival in schemas.rivals(step.decision.winner, scaled)
    ]


def _nodes(imitator: Imitator, percept: Tensor) -> list[dict[str, Any]]:
    """Return the nodes nearest to a percept `[D]`, the nearest first."""
    sofm = imitator.network.sofm
    distance = torch.linalg.vector_norm((sofm.prototypes - percept) * sofm.scale, dim=1)
    nearest = distance.argsort(stable=True)[:_NODES].tolist()
    return [
        {
            "node": node,
            "distance": float(distance[node]),
            "activation": float(torch.exp(-distance[node])),
            "schemas": len(imitator.schemas.schemas_of(node)),
        }
        for node in nearest
    ]
