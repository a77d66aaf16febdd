"""Recorded episodes as they were recognised, also as extra columns of their dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from numpy.typing import NDArray

from pacnet.competition.recognition import Recognition
from pacnet.datasets.demonstrations import Demonstration


@dataclass(frozen=True, eq=False)
class Watched:
    """An episode and what was recognised in each of its frames."""

    demonstration: Demonstration
    recognition: Recognition

    def known_as(self, behaviours: Sequence[str]) -> bool:
        """Whether it was recorded as one of these behaviours."""
        return self.demonstration.task in behaviours

    @property
    def named_since(self) -> int:
        """The frame from which on no other behaviour than that of the end was the most probable."""
        most_probable = self.recognition.behaviour
        others = (most_probable != most_probable[-1]).nonzero()
        return int(others[-1]) + 1 if len(others) else 0


def joined(parts: Sequence[Recognition]) -> Recognition:
    """One recognition of frames that were recognised in several parts, one after the other."""
    return Recognition(*map(torch.cat, zip(*parts, strict=True)))


def shown(behaviours: Sequence[str]) -> tuple[str, ...]:
    """What the behaviours are called where a name is needed."""
    return tuple(name or "untitled" for name in behaviours)


def column_names(behaviours: Sequence[str], percept: Sequence[str]) -> dict[str, Sequence[str]]:
    """The extra columns of the dataset and their dimensions.

    Args:
        behaviours: name of each behaviour that the network knows.
        percept: name of each dimension of a percept.
    """
    scalars = ("progress", "novelty", "is_novel", "winner")
    return {
        "behaviour": shown(behaviours),
        **{name: (name,) for name in scalars},
        "expected_next": percept,
        "expected_end": percept,
    }


def column_values(recognition: Recognition) -> dict[str, NDArray[Any]]:
    """The extra columns of an episode [T, K]."""
    return {
        "behaviour": recognition.probability.numpy(),
        "progress": recognition.progress[:, None].numpy(),
        "novelty": recognition.novelty[:, None].numpy(),
        "is_novel": recognition.is_novel[:, None].numpy(),
        "winner": recognition.winner[:, None].numpy(),
        "expected_next": recognition.next_percept.numpy(),
        "expected_end": recognition.end_percept.numpy(),
    }
