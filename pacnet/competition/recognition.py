"""Recognition: what is being watched, how far it is, what comes next, how it ends, how new it is.

Maistros, Marom & Hayes (2001) hope that coupling perception to action lets a robot "'understand'
the observed interactions of others". Here the schemas by which the robot would act are run along
with what it sees, and nothing is done.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.schemas.sequences import as_array

_BIAS_RATE = 0.2  # per sample, at which the difference from the known episodes is followed


class Recognition(NamedTuple):
    """What was understood at each sample. T percepts, B known behaviours."""

    probability: Tensor
    """Of each known behaviour, `[T, B]`; rows sum to 1."""
    behaviour: Tensor
    """Number of the most probable behaviour, int64 `[T]`."""
    progress: Tensor
    """How much of that behaviour is over, `[T]`, from 0 to 1."""
    next_percept: Tensor
    """What is expected one sample later, `[T, D]`, in the percept's own units."""
    end_percept: Tensor
    """What is expected at the end of that behaviour, `[T, D]`, in the percept's own units."""
    novelty: Tensor
    """1 − exp(−distance to the nearest percept that is known), `[T]`."""
    is_novel: Tensor
    """Whether the novelty is over `RecognitionConfig.novel_above`, bool `[T]`."""
    winner: Tensor
    """Node of the map, int64 `[T]`, or `NO_NODE` where the match is not good enough."""


class Understanding(NamedTuple):
    """What was understood of one percept; as `Recognition`, in the map's scaled units."""

    probability: NDArray[np.floating]  # [B]
    behaviour: int
    progress: float
    next_percept: NDArray[np.floating]  # [D]
    end_percept: NDArray[np.floating]  # [D]
    novelty: float


class Watcher:
    """Follows one episode, by what was known when it began.

    Args:
        schemas: by which the robot would act; at least one.

    Attributes:
        novel_above: the novelty over which a percept is called novel.
    """

    def __init__(self, schemas: CompetingSchemas) -> None:
        recall = schemas.new_recall()
        if recall is None:
            raise ValueError(
                "expected a network that has learned schemas, got one without any: no node has "
                "habituated and kept targets; show it more, or look at SOFMConfig.scale"
            )
        recall.schemas.check()
        self._recall, self._belief, timeline = recall, recall.belief, recall.timeline
        known = torch.from_numpy(timeline.episode)
        episodes = recall.schemas.episodes
        self._behaviours = len(schemas.behaviours)
        self._kinds = episodes.live("behaviour").cpu()[known].numpy()  # [E]
        self._last = as_array(episodes.live("last_cue").cpu()[known])  # [E, D]
        self._bias = np.zeros(self._last.shape[1], self._last.dtype)
        self.novel_above = schemas.config.recognition.novel_above

    def see(self, percept: NDArray[np.floating]) -> Understanding:
        """Takes one percept in, `[D]`, scaled."""
        distances = self._recall.distances(percept)
        self._belief.update(distances)
        of_episodes = self._belief.of_episodes()
        probability = np.bincount(self._kinds, of_episodes, minlength=self._behaviours)
        behaviour = int(probability.argmax())

        # The rest is about the most probable behaviour alone: no mean of two different futures.
        ours = (self._kinds == behaviour)[:, None]
        now = _normalised(self._belief.probability * ours)  # [E, P]
        soon = _normalised(self._belief.ahead() * ours)
        middle = (np.arange(now.shape[1]) + 0.5) / now.shape[1]
        # What sets this episode apart from the known ones lasts for more than a sample.
        apart = percept - self._expected(now) - self._bias
        self._bias = self._bias + _BIAS_RATE * apart
        return Understanding(
            probability.astype(percept.dtype),
            behaviour,
            float(now.sum(axis=0) @ middle),
            self._expected(soon) + self._bias,
            now.sum(axis=1).astype(self._last.dtype) @ self._last,
            1 - math.exp(-distances.min()),
        )

    def _expected(self, probability: NDArray[np.float64]) -> NDArray[np.floating]:
        """The mean cue `[D]` over places of the timeline `[E, P]`."""
        cues, rows = self._recall.cues, self._recall.timeline.rows
        of_row = np.bincount(rows.ravel(), probability.ravel(), minlength=len(cues))
        return of_row.astype(cues.dtype) @ cues


def _normalised(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    return probability / probability.sum()
