"""Why an imitator acts or holds at one frame, as a document for JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.cli.explained_pictures import describe_sights, draw, look_at
from pacnet.cli.explained_segment import followed_segment, moved_deviation
from pacnet.cli.replay import reason_of
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import Followed, task_name


def explain(
    imitator: Imitator,
    demonstrations: Demonstrations,
    episode: int,
    frame: int,
    task: str | None = None,
    picture: Path | None = None,
) -> dict[str, Any]:
    """Run over the episode from its start to the frame, and return what decided there.

    Args:
        imitator: starts a new recall episode.
        demonstrations: of the imitator's features.
        episode: number of the episode in its dataset.
        frame: of the episode, from 0.
        task: as of `Imitator.reset`.
        picture: file to draw what the cameras see to, beside what is remembered; None for none.

    Raises:
        ValueError: no such episode or frame, or an unknown task.
    """
    shown = _find(demonstrations, episode, frame)
    imitator.reset(task)
    until = shown.part(0, frame + 1)
    step = [*imitator.follow(until)][-1]
    sights = look_at(imitator, until)
    percept = until.percepts[-1]
    if sights is not None and imitator.config.tells_places:
        percept = torch.cat([percept, torch.from_numpy(sights.seen.goals)])
    document = {
        "dataset": demonstrations.source,
        "episode": episode,
        "task": shown.task,
        "frame": frame,
        "seconds": frame / demonstrations.fps,
        "decision": "acts" if step.action is not None else "holds",
        "reason": reason_of(step, imitator.cameras).sentence,
        "asked_for": None if task is None else task_name(task),
        "progress": step.progress,
        "is_done": step.is_done,
        "novelty": step.novelty,
        "is_novel": step.is_novel,
        "dimension": step.dimension,
        "deviation": step.deviation,
        "threshold": step.threshold,
        **_attention(imitator, percept),
        "targets_are": imitator.config.targets,
        "target": _named(_target_names(imitator), step.target),
        "action": _named(imitator.config.action, step.action),
        "segment": followed_segment(imitator, step),
        "followed": [
            _moment(imitator, one, percept.numpy()) | moved_deviation(imitator, step)
            for one in step.followed
        ],
        "percept": _named(imitator.percept_names, percept),
        "cameras": describe_sights(imitator, sights, step, demonstrations.fps),
    }
    if picture is not None and sights is not None:
        draw(imitator, sights, step, document, picture)
    return document


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


def _target_names(imitator: Imitator) -> tuple[str, ...]:
    """Return the names of a target's dimensions, those of a state as in the percept.

    A target that is a state ends with the actions that do not move it.
    """
    config = imitator.config
    if config.targets == "action":
        return config.action
    actions = tuple(config.action[number] for number in config.still_actions)
    return (*imitator.percept_names[: config.state_dimensions], *map(_as_action, actions))


def _as_action(name: str) -> str:
    return f"{name} (action)"  # a dimension of the state may have its name


def _attention(imitator: Imitator, percept: Tensor) -> dict[str, Any]:
    """Return what the map reads of a percept `[D]`."""
    read = imitator.sofm(percept[None])
    return {
        "winner": int(read.winner),
        "activation": float(read.activation),
        "matches": not bool(read.novelty),
        "novelty_threshold": imitator.config.attention.novelty_threshold,
    }


def _moment(imitator: Imitator, one: Followed, percept: NDArray[np.float32]) -> dict[str, Any]:
    """Return the present moment of a demonstration that is followed, beside a percept `[D]`.

    The deviation is that in the dimension where it is largest beside the novelty threshold.
    """
    report, shown = imitator.reports[one.demonstration], imitator.memory.whole()
    first, end = shown.first[one.demonstration : one.demonstration + 2]
    row = first + int(np.searchsorted(shown.frame[first:end], one.frame))
    scale = imitator.config.scaling.array
    apart = percept * scale - shown.percepts[row]
    most = int((np.abs(apart) / imitator.novelty_detector.thresholds.numpy()).argmax())
    frame = report.first_frame + one.frame
    return {
        "dataset": report.dataset,
        "episode": report.episode,
        "task": report.task,
        "frame": frame,
        "seconds": frame / imitator.config.fps,
        "weight": one.weight,
        "dimension": imitator.percept_names[most],
        "deviation": float(apart[most] / scale[most]),
        "target": _named(_target_names(imitator), shown.targets[row]),
    }
