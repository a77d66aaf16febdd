"""Recognition: which behaviour is observed, its progress, what comes next, and how novel it is.

Maistros, Marom & Hayes (2001) hope that coupling perception to action lets a robot "'understand'
the observed interactions of others". Here the schemas that would drive the robot run along with
what it perceives, and no action is taken.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.competition.belief import Belief, RecognitionConfig
from pacnet.competition.timeline import Timeline

_BIAS_RATE = 0.2  # per sample, at which the deviation from the known episodes is followed


class Recognition(NamedTuple):
    """What was recognized at each sample. T percepts, B known behaviours."""

    probability: Tensor
    """Of each known behaviour, `[T, B]`; rows sum to 1."""
    behaviour: Tensor
    """Index of the most probable behaviour, int64 `[T]`."""
    progress: Tensor
    """Share of that behaviour that is over, `[T]`, from 0 to 1."""
    next_percept: Tensor
    """The percept expected one sample later, `[T, D]`, in the percept's own units."""
    end_percept: Tensor
    """The percept expected at the end of that behaviour, `[T, D]`, in the percept's own units."""
    novelty: Tensor
    """Of a network 1 − exp(−distance to the nearest known percept), of an imitator as in its steps,
    `[T]`."""
    is_novel: Tensor
    """Whether the novelty is above `RecognitionConfig.novel_above`, of an imitator 1, `[T]`."""
    winner: Tensor
    """Node of the map, int64 `[T]`, or `NO_NODE` where the match is not good enough."""


class RecognitionStep(NamedTuple):
    """What was recognized at one percept; as `Recognition`, in normalized units."""

    probability: NDArray[np.floating]  # [B]
    behaviour: int
    progress: float
    next_percept: NDArray[np.floating]  # [D]
    end_percept: NDArray[np.floating]  # [D]
    novelty: float


class Recognizer:
    """Recognition of one episode, percept by percept.

    Args:
        timeline: of E known episodes.
        cues: the percepts that it refers to, normalized, `[R, D]`.
        behaviour_of: which behaviour each episode shows, `[E]`.
        behaviours: number of behaviours.
        last: the last percept of each episode, normalized, `[E, D]`.
        config: see `RecognitionConfig`.

    Attributes:
        novel_above: the novelty above which a percept is called novel.
    """

    def __init__(
        self,
        timeline: Timeline,
        cues: NDArray[np.floating],
        behaviour_of: NDArray[np.int64],
        behaviours: int,
        last: NDArray[np.floating],
        config: RecognitionConfig,
    ) -> None:
        self._belief, self._rows = Belief(timeline, config), timeline.rows
        self._cues = np.asfortranarray(cues)  # the layout distances are taken in
        self._behaviour_of, self._n_behaviours, self._last = behaviour_of, behaviours, last
        self._bias = np.zeros(last.shape[1], last.dtype)
        self.novel_above = config.novel_above

    def columns(self, percepts: NDArray[np.floating]) -> list[Tensor]:
        """Return the fields of `RecognitionStep` for several percepts `[T, D]`, each `[T, ...]`."""
        steps = map(self.update, percepts)
        return [torch.from_numpy(np.stack(field)) for field in zip(*steps, strict=True)]

    def update(self, percept: NDArray[np.floating]) -> RecognitionStep:
        """Recognize one more percept of the episode, normalized, `[D]`."""
        from pacnet.kernels.distances import distances_of  # imports numba

        distances = distances_of(percept, self._cues)
        self._belief.update(distances)
        of_episodes = self._belief.probability.sum(axis=1)
        probability = np.bincount(self._behaviour_of, of_episodes, minlength=self._n_behaviours)
        behaviour = int(probability.argmax())

        # All else is of the most probable behaviour: the mean of two futures may be neither.
        ours = (self._behaviour_of == behaviour)[:, None]
        now = _normalized(self._belief.probability * ours)  # [E, P]
        soon = _normalized(self._belief.predict() * ours)
        middle = (np.arange(now.shape[1]) + 0.5) / now.shape[1]
        # An episode's deviation from the known ones lasts for many samples.
        deviation = percept - self._expected(now) - self._bias
        self._bias = self._bias + _BIAS_RATE * deviation
        return RecognitionStep(
            probability.astype(percept.dtype),
            behaviour,
            float(now.sum(axis=0) @ middle),
            self._expected(soon) + self._bias,
            now.sum(axis=1).astype(self._last.dtype) @ self._last,
            1 - math.exp(-distances.min()),
        )

    def _expected(self, probability: NDArray[np.float64]) -> NDArray[np.floating]:
        """Return the mean cue `[D]` over states of the timeline `[E, P]`."""
        cues = self._cues
        of_row = np.bincount(self._rows.ravel(), probability.ravel(), minlength=len(cues))
        return of_row.astype(cues.dtype) @ cues


def _normalized(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    return probability / probability.sum()
