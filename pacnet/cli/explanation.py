"""Why an imitator would do what it would do at one frame, as JSON holds it."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from pacnet.cli.reasons import reason_of
from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.competition.winner_take_all import NO_SCHEMA
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator, ImitatorStep

_NODES = 5  # nearest ones that are shown


def explain(
    imitator: Imitator, demonstrations: Demonstrations, episode: int, frame: int
) -> dict[str, Any]:
    """Watches the episode from its start up to the frame, and says what decided there.

    Args:
        imitator: its recall episode is begun anew.
        demonstrations: of the features that it perceives.
        episode: number of the episode in its dataset.
        frame: of the episode, from 0.

    Raises:
        ValueError: no such episode or frame.
    """
    shown = _find(demonstrations, episode, frame)
    imitator.reset()
    percepts = shown.percepts[: frame + 1]
    steps = [imitator.step(percept) for percept in percepts.numpy()]
    step = steps[-1]
    return {
        "dataset": demonstrations.source,
        "episode": episode,
        "task": shown.task,
        "frame": frame,
        "seconds": frame / demonstrations.fps,
        "does": "acts" if step.action is not None else "holds",
        "because": reason_of(step).sentence,
        "novelty": step.novelty,
        "is_novel": step.is_novel,
        "dimension": step.dimension,
        "deviation": step.deviation,
        "tolerated": step.tolerated,
        "percept": dict(zip(imitator.percept_names, percepts[-1].tolist(), strict=True)),
        **_choice(imitator, step),
        "targets_are": imitator.config.targets,
        "target": _target(imitator, step),
        "action": _named(imitator.config.action, step.action),
        "origins": _origins(imitator, step),
        "margin": _competing(imitator).config.margin,
        "schemas": _rivals(imitator, step, percepts[-1]),
        "nodes": _nodes(imitator, percepts[-1]),
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


def _choice(imitator: Imitator, step: ImitatorStep) -> dict[str, Any]:
    """Which node won, which of its schemas, and which of the schema's targets."""
    decision = step.decision
    commanded = decision.schema != NO_SCHEMA
    return {
        "winner": decision.winner,
        "activation": decision.activation,
        "matches": not decision.is_novel,
        "matches_from": imitator.config.network.attention.novelty_threshold,
        "schema": decision.schema if commanded else None,
        "position": decision.offset if commanded else None,
    }


def _target(imitator: Imitator, step: ImitatorStep) -> dict[str, float] | None:
    """What was recalled, by name; where it is a state, that is not yet the action."""
    config = imitator.config
    names = config.action if config.targets == "action" else next(iter(config.percepts.values()))
    return _named(names, step.decision.target)


def _named(names: tuple[str, ...], values: Any) -> dict[str, float] | None:
    return None if values is None else dict(zip(names, values.tolist(), strict=True))


def _origins(imitator: Imitator, step: ImitatorStep) -> list[dict[str, Any]]:
    """The frames of demonstrations that the target stands for."""
    schema, position = step.decision.schema, step.decision.offset
    if schema == NO_SCHEMA:
        return []
    origins = []
    for origin in _competing(imitator).origins(schema, position):
        lesson = imitator.lessons[origin.episode]
        origins.append(
            {
                "dataset": lesson.dataset,
                "episode": lesson.episode,
                "task": lesson.task,
                "frame": origin.frame,
                "seconds": origin.frame / imitator.config.fps,
            }
        )
    return origins


def _rivals(imitator: Imitator, step: ImitatorStep, percept: Tensor) -> list[dict[str, Any]]:
    """The motor schemas that competed, of other nodes too if none of the winner's is confident."""
    schemas = _competing(imitator)
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
    """The nodes nearest to a percept `[D]`, the nearest first."""
    sofm = imitator.network.sofm
    apart = torch.linalg.vector_norm((sofm.prototypes - percept) * sofm.scale, dim=1)
    nearest = apart.argsort(stable=True)[:_NODES].tolist()
    distances = apart.tolist()
    return [
        {
            "node": node,
            "distance": distances[node],
            "activation": float(torch.exp(-apart[node])),
            "schemas": len(_competing(imitator).schemas_of(node)),
        }
        for node in nearest
    ]


def _competing(imitator: Imitator) -> CompetingSchemas:
    schemas = imitator.network.schemas
    assert isinstance(schemas, CompetingSchemas)  # of every imitator
    return schemas
