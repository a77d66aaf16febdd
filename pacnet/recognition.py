"""Recognition: what is being watched, how far it is, what comes next, how it ends, how new it is.

Maistros, Marom & Hayes (2001) hope that coupling perception to action lets a robot "'understand'
the observed interactions of others". Here the schemas by which the robot would act are run along
with what it sees, and nothing is done.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from pacnet.competing_schemas import CompetingSchemas

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
    """Node of the map, int64 `[T]`, or `NOBODY` where the match is not good enough."""


class Understanding(NamedTuple):
    """What was understood of one percept; as `Recognition`, in the map's scaled units."""

    probability: Tensor  # [B]
    behaviour: Tensor
    progress: Tensor
    next_percept: Tensor  # [D]
    end_percept: Tensor  # [D]
    novelty: Tensor


class Watcher:
    """Follows one episode.

    Args:
        schemas: by which the robot would act; at least one.
    """

    def __init__(self, schemas: CompetingSchemas) -> None:
        recall = schemas.new_recall()
        if recall is None:
            raise ValueError(
                "expected a network that has learned schemas, got one without any: no node has "
                "habituated and kept targets; show it more, or look at SOFMConfig.scale"
            )
        self._schemas = schemas
        self._recall, self._belief, self._timeline = recall, recall.belief, recall.timeline
        self._kinds = schemas.episodes.live("behaviour")[recall.timeline.episode]  # [E]
        self._bias = schemas.pool.live("cue").new_zeros(schemas.config.percept_dimensions)

    @property
    def is_current(self) -> bool:
        """Whether nothing was learned since."""
        return self._schemas.timeline() is self._timeline

    def see(self, percept: Tensor) -> Understanding:
        """Takes one percept in, `[D]`, scaled."""
        distances = self._recall.distances(percept)
        self._belief.update(distances)
        probability = self._belief.probability.new_zeros(len(self._schemas.behaviours))
        probability.index_add_(0, self._kinds, self._belief.of_episodes())
        behaviour = probability.argmax()

        # The rest is about the most probable behaviour alone: no mean of two different futures.
        ours = (self._kinds == behaviour)[:, None]
        now = _normalised(self._belief.probability * ours)  # [E, P]
        soon = _normalised(self._belief.ahead() * ours)
        middle = (torch.arange(now.shape[1], device=now.device) + 0.5) / now.shape[1]
        last = self._schemas.episodes.live("last_cue")[self._timeline.episode]
        # What sets this episode apart from the known ones lasts for more than a sample.
        apart = percept - self._expected(now) - self._bias
        self._bias = self._bias + _BIAS_RATE * apart  # not in place: see `torch.inference_mode`
        return Understanding(
            probability.to(percept.dtype),
            behaviour,
            (now.sum(dim=0) @ middle.to(now.dtype)).to(percept.dtype),
            self._expected(soon) + self._bias,
            now.sum(dim=1).to(last.dtype) @ last,
            1 - torch.exp(-distances.amin()),
        )

    def _expected(self, probability: Tensor) -> Tensor:
        """The mean cue `[D]` over places of the timeline `[E, P]`."""
        cues = self._schemas.pool.live("cue")
        of_row = probability.new_zeros(len(cues))
        of_row.index_add_(0, self._timeline.rows.flatten(), probability.flatten())
        return of_row.to(cues.dtype) @ cues


def _normalised(probability: Tensor) -> Tensor:
    return probability / probability.sum()
