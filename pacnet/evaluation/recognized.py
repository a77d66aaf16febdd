"""Recorded episodes with what was recognized in them, also as extra columns of their dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from numpy.typing import NDArray

from pacnet.competition.recognition import Recognition
from pacnet.datasets.demonstrations import Demonstration


@dataclass(frozen=True, eq=False)
class RecognizedEpisode:
    """An episode and what was recognized in each of its frames."""

    demonstration: Demonstration
    recognition: Recognition

    @property
    def stable_from(self) -> int:
        """Return the first frame from which the most probable behaviour stays the same."""
        most_probable = self.recognition.behaviour
        changes = (most_probable != most_probable[-1]).nonzero()
        return int(changes[-1]) + 1 if len(changes) else 0


def concatenate(parts: Sequence[Recognition]) -> Recognition:
    """Return one recognition of frames that were recognized in consecutive parts."""
    return Recognition(*map(torch.cat, zip(*parts, strict=True)))


def display_names(behaviours: Sequence[str]) -> tuple[str, ...]:
    """Return the behaviours' names, with "untitled" in place of an empty one."""
    return tuple(name or "untitled" for name in behaviours)


def column_names(behaviours: Sequence[str], percept: Sequence[str]) -> dict[str, Sequence[str]]:
    """Return the extra columns of a dataset: column -> the names of its dimensions.

    Args:
        behaviours: name of each behaviour that the network knows.
        percept: name of each dimension of a percept.
    """
    scalars = ("progress", "novelty", "is_novel", "winner")
    return {
        "behaviour": display_names(behaviours),
        **{name: (name,) for name in scalars},
        "expected_next": percept,
        "expected_end": percept,
    }


def column_values(recognition: Recognition) -> dict[str, NDArray[Any]]:
    """Return the extra columns of an episode, each `[T, K]`."""
    return {
        "behaviour": recognition.probability.numpy(),
        "progress": recognition.progress[:, None].numpy(),
        "novelty": recognition.novelty[:, None].numpy(),
        "is_novel": recognition.is_novel[:, None].numpy(),
        "winner": recognition.winner[:, None].numpy(),
        "expected_next": recognition.next_percept.numpy(),
        "expected_end": recognition.end_percept.numpy(),
    }
