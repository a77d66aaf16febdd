"""Which known episode is being watched, and how far it is: a forward filter over all of them.

An episode is remembered as the sequences of targets that it passed through (`CompetingSchemas`).
Cut into equal parts from its beginning to its end, its timeline is a chain of places, each with the
percept that is expected there. At each sample the belief moves on along the chains at the pace at
which they were shown, and is then weighed by how well each place fits the percept: the forward
algorithm of a hidden Markov model whose states are the places of all episodes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.validation import check_fields, is_integer, is_number

_MOST_PLACES = 2**16  # parts of an episode: the belief takes memory for each of them


@dataclass(frozen=True)
class RecognitionConfig:
    """How a known episode is recognised.

    Distances are in the map's scaled units, in which the noise of a percept should have a length of
    0.1 or so: the square root of the sum over dimensions of (noise × scale)². Where it is larger,
    widths and thresholds must be too, or the scale smaller.

    Attributes:
        places: parts P that each known episode is cut into.
        width: standard deviation of the likelihood, in the map's scaled units: how far a percept
            may well be from the one expected. Larger than the noise of a single percept, for what
            sets one demonstration apart from another lasts for many samples.
        mismatch: likelihood of a percept that fits nothing, relative to one that fits wholly. It
            keeps a burst of noise from deciding what is being watched.
        restart: chance that a sample belongs to some other place of some other episode.
        novel_above: novelty over which a percept is called novel, in (0, 1). Two percepts of the
            same instant are √2 times the noise apart; look at what known episodes give.
    """

    places: int = 128
    width: float = 0.3
    mismatch: float = 1e-3
    restart: float = 1e-4
    novel_above: float = 0.3

    def __post_init__(self) -> None:
        """Refuses values that have no meaning."""
        width = is_number(self.width) and self.width > 0
        checks = {
            "places": (
                is_integer(self.places, 2) and self.places <= _MOST_PLACES,
                f"to be an integer from 2 to {_MOST_PLACES}",
            ),
            "width": (width, "> 0 and finite"),
        }
        for name in ("mismatch", "restart", "novel_above"):
            value = getattr(self, name)
            checks[name] = (is_number(value) and 0 < value < 1, "in (0, 1)")
        check_fields(self, checks)


class Timeline(NamedTuple):
    """What the belief is about: E known episodes of P places each."""

    rows: NDArray[np.int64]
    """The row of the pool whose cue is expected at each place, int64 `[E, P]`."""
    episode: NDArray[np.int64]
    """Which of the remembered episodes each is, int64 `[E]`."""
    advance: NDArray[np.float64]
    """Chance that one sample takes the episode on by 0, 1, … places, `[E, K]`."""
    start: NDArray[np.float64]
    """Where episodes begin: the belief before the first sample, `[E, P]`; sums to 1."""


def make_timeline(rows: Tensor, episode: Tensor, samples: Tensor, behaviour: Tensor) -> Timeline:
    """A timeline in which every behaviour is as likely as any other.

    An episode that is watched most likely begins at its first place; half of the belief says so,
    and half lies everywhere.

    Args:
        rows: `[E, P]` as in `Timeline`.
        episode: `[E]` as in `Timeline`.
        samples: how many each episode lasted, int64 `[E]`.
        behaviour: of each episode, int64 `[E]`.
    """
    episodes, places = rows.shape
    rate = places / samples.double()  # [E] places per sample
    steps = torch.arange(math.ceil(float(rate.max()) * 3) + 3, device=rows.device)
    # Poisson, so that a demonstration may be faster or slower than the remembered one.
    log_chance = steps * rate[:, None].log() - rate[:, None] - torch.lgamma(steps + 1.0)
    advance = log_chance.exp()
    _, kind, count = behaviour.unique(return_inverse=True, return_counts=True)
    prior = 1 / count[kind].double()  # [E]
    start = torch.full((episodes, places), 0.5 / places, dtype=torch.float64, device=rows.device)
    start[:, 0] += 0.5
    start *= prior[:, None]
    advance /= advance.sum(dim=1, keepdim=True)
    fields = rows, episode, advance, start / start.sum()
    return Timeline(*(field.contiguous().numpy(force=True) for field in fields))


class Belief:
    """The probability of every place of every known episode, given the percepts so far.

    Args:
        timeline: of the known episodes.
        config: see `RecognitionConfig`.

    Attributes:
        probability: of every place of every known episode, float64 `[E, P]`.
        has_begun: whether a percept was taken in.
    """

    def __init__(self, timeline: Timeline, config: RecognitionConfig) -> None:
        self.timeline, self.config = timeline, config
        self.probability = timeline.start
        self.has_begun = False
        self._ahead: NDArray[np.float64] | None = None

    def ahead(self) -> NDArray[np.float64]:
        """The belief one sample on, before anything new is seen, `[E, P]`."""
        if self._ahead is None:
            from pacnet.competition import kernels as recall_kernels  # which brings numba

            self._ahead = np.empty_like(self.probability)
            recall_kernels.move_on(self.probability, self.timeline.advance, self._ahead)
        return self._ahead

    def update(self, distances: NDArray[np.floating]) -> None:
        """Takes in one percept.

        Args:
            distances: of the percept from the cue of every row of the pool, `[R]`.

        Raises:
            ValueError: fewer than there are rows on the timeline.
        """
        from pacnet.competition import kernels as recall_kernels  # which brings numba

        start, restart = self.timeline.start, self.config.restart if self.has_begun else 0.0
        probability = np.empty_like(start)
        fits = recall_kernels.weigh(
            self.ahead() if self.has_begun else start, start, restart, self.timeline.rows,
            distances, self.config.width, self.config.mismatch, probability,
        )  # fmt: skip
        if not fits:
            raise ValueError(f"expected a distance for each row expected, got {len(distances)}")
        self.probability, self.has_begun, self._ahead = probability, True, None

    def of_episodes(self) -> NDArray[np.float64]:
        """The probability of each known episode, `[E]`."""
        return self.probability.sum(axis=1)
