"""What cameras see at a frame, beside the picture of the demonstration that drives the action."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from pacnet.cli.cameras import short_name
from pacnet.datasets.demonstrations import Demonstration
from pacnet.evaluation.sight_figures import Picture, Sighting, beside_remembered
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.records import ImitatorStep
from pacnet.vision.encoder import ImageEncoder, Look
from pacnet.vision.sight import Seen


class Sights(NamedTuple):
    """What is seen at the last frame of an episode or of its beginning."""

    shown: Demonstration
    seen: Seen
    looked_at: int
    """Frame of the last look; later the hand may be in the way."""


def look_at(imitator: Imitator, shown: Demonstration) -> Sights | None:
    """Return what the cameras see at an episode's last frame, as while acting; None without any.

    Raises:
        ValueError: it lacks a camera.
    """
    if imitator.cameras is None:
        return None
    every = imitator.cameras.look_at(shown)
    return Sights(shown, every[-1], next(n for n, one in enumerate(every) if one is every[-1]))


def describe_sights(
    imitator: Imitator, sights: Sights | None, step: ImitatorStep, fps: float
) -> list[dict[str, Any]]:
    """Return what each camera sees, for JSON.

    Returns:
        For each camera its `feature`; the `doubt`, above 1 where the picture is new; when it was
        last `looked_at` [s]; the `boxes` of what is attended to: left, top, right and bottom, in
        shares of the picture; and what is `remembered`: the beginning of an episode, which
        `is_followed` or else the most alike, or None where no picture was shown.
    """
    if sights is None or imitator.cameras is None:
        return []
    described = []
    for (feature, encoder), look in zip(
        imitator.cameras.encoders.items(), sights.seen.looks, strict=True
    ):
        described.append(
            {
                "feature": feature,
                "doubt": look.doubt,
                "looked_at": sights.looked_at / fps,
                "boxes": _shares(encoder, look),
                "remembered": _beginning(imitator, encoder, step, look),
            }
        )
    return described


def draw(
    imitator: Imitator, sights: Sights, step: ImitatorStep, document: dict[str, Any], file: Path
) -> None:
    """Draw what each camera sees beside what is remembered.

    Args:
        imitator: with cameras.
        sights: at the frame.
        step: there.
        document: as `pacnet.cli.explanation.explain` returns it.
        file: to write.
    """
    assert imitator.cameras is not None
    sightings = []
    for (feature, encoder), look, camera in zip(
        imitator.cameras.encoders.items(), sights.seen.looks, document["cameras"], strict=True
    ):
        pixels, remembered = np.array(sights.shown.pictures[feature][-1]), None
        if camera["remembered"] is not None:
            row, _ = _remembered(imitator, encoder, step, look)
            before = encoder.shown.live("picture")[row]
            boxes = _shares(encoder, encoder.look(before))
            remembered = Picture(before.numpy(), boxes, _then(camera["remembered"]))
        sightings.append(
            Sighting(
                short_name(feature),
                Picture(pixels, camera["boxes"], _now(document), look.doubt <= 1),
                remembered,
                _about(camera, document),
            )
        )
    beside_remembered(sightings, _headline(document), _way(document)).savefig(file)


def _beginning(
    imitator: Imitator, encoder: ImageEncoder, step: ImitatorStep, look: Look
) -> dict[str, Any] | None:
    """Return of which episode a picture is remembered, for JSON; None without any picture."""
    if len(encoder.shown) == 0:
        return None
    row, is_followed = _remembered(imitator, encoder, step, look)
    report = imitator.reports[int(encoder.shown.live("demonstration")[row])]
    return {"dataset": report.dataset, "episode": report.episode, "is_followed": is_followed}


def _remembered(
    imitator: Imitator, encoder: ImageEncoder, step: ImitatorStep, look: Look
) -> tuple[int, bool]:
    """Return the row of the picture that is remembered, of some, and whether that is followed."""
    numbers = encoder.shown.live("demonstration")
    if step.followed:
        reports, followed = imitator.reports, step.followed[0].demonstration
        row = int(torch.searchsorted(numbers, followed, right=True)) - 1
        place = (reports[followed].dataset, reports[followed].episode)
        own = reports[int(numbers[row])]
        if row >= 0 and (own.dataset, own.episode) == place:
            return row, True
    apart = (encoder.shown.live("goals") - look.goals).norm(dim=1)
    return int(apart.argmin()), False


def _shares(encoder: ImageEncoder, look: Look) -> list[list[float]]:
    """Return boxes in shares of the picture's width and height."""
    size = np.array([encoder.config.width, encoder.config.height] * 2)
    return [(np.array(box) / size).tolist() for box in look.boxes]


def _now(document: dict[str, Any]) -> str:
    return (
        f"now\nepisode {document['episode']} of {document['dataset']}, {document['seconds']:.2f} s"
    )


def _then(before: dict[str, Any]) -> str:
    which = "remembered, and followed" if before["is_followed"] else "remembered, the most alike"
    return f"{which}\nbeginning of episode {before['episode']} of {before['dataset']}"


def _about(camera: dict[str, Any], document: dict[str, Any]) -> str:
    """Return in words how alike both pictures are."""
    alike = "new" if camera["doubt"] > 1 else "known"
    text = f"{alike}: doubt {camera['doubt']:.2f}, new above 1"
    if camera["looked_at"] < document["seconds"]:
        text += f"; boxes as at {camera['looked_at']:.2f} s, before the hand was in the way"
    return text


def _headline(document: dict[str, Any]) -> str:
    task = document["task"] or "untitled"
    return f"“{task}”: {document['decision']}, since {document['reason']}"


def _way(document: dict[str, Any]) -> str:
    """Return in words what is done."""
    if not document["followed"]:
        return "nothing is followed"
    segment = document["segment"]
    if segment is None:
        return f"{document['progress']:.0%} of what is followed is over"
    text = f"{segment['moved']} is on the way to {segment['landmark']} (segment "
    text += f"{segment['number']} of {segment['of']})"
    if segment["distance"] is not None:
        text += (
            f", {segment['distance']:.3g} from {segment['reference']} now and "
            f"{segment['distance_shown']:.3g} when it was shown"
        )
    return f"{text}; {document['progress']:.0%} is over"
