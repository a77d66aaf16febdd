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

import torch
from torch import Tensor

from pacnet.validation import check_fields, is_integer, is_number


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
            "places": (is_integer(self.places, 2), "≥ 2"),
            "width": (width, "> 0 and finite"),
        }
        for name in ("mismatch", "restart", "novel_above"):
            value = getattr(self, name)
            checks[name] = (is_number(value) and 0 < value < 1, "in (0, 1)")
        check_fields(self, checks)


class Timeline(NamedTuple):
    """What the belief is about: E known episodes of P places each."""

    rows: Tensor
    """The row of the pool whose cue is expected at each place, int64 `[E, P]`."""
    episode: Tensor
    """Which of the remembered episodes each is, int64 `[E]`."""
    advance: Tensor
    """Chance that one sample takes the episode on by 0, 1, … places, `[E, K]`."""
    start: Tensor
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
    return Timeline(rows, episode, advance / advance.sum(dim=1, keepdim=True), start / start.sum())


class Belief:
    """The probability of every place of every known episode, given the percepts so far.

    Args:
        timeline: of the known episodes.
        config: see `RecognitionConfig`.

    Attributes:
        probability: of every place of every known episode, `[E, P]`.
        has_begun: whether a percept was taken in.
    """

    def __init__(self, timeline: Timeline, config: RecognitionConfig) -> None:
        self.timeline = timeline
        self.config = config
        self.probability = timeline.start
        self.has_begun = False
        self._ahead: Tensor | None = None
        self._restart = config.restart * timeline.start
        self._chances = timeline.advance.flip(1)[:, None].contiguous()  # [E, 1, K]

    def ahead(self) -> Tensor:
        """The belief one sample on, before anything new is seen, `[E, P]`."""
        if self._ahead is None:
            self._ahead = self._move_on()
        return self._ahead

    def update(self, distances: Tensor) -> None:
        """Takes in one percept.

        Args:
            distances: of the percept from the cue of every row of the pool, `[R]`.
        """
        expected = self.timeline.start
        if self.has_begun:
            expected = self._restart + (1 - self.config.restart) * self.ahead()
        apart = distances.take(self.timeline.rows).double()  # [E, P]; not of all R rows
        fit = apart.div_(self.config.width).square_().div_(-2).exp_()
        weighed = fit.add_(self.config.mismatch).mul_(expected)
        self._begin(weighed.div_(weighed.sum()))

    def _begin(self, probability: Tensor) -> None:
        """Or goes on: what is believed `[E, P]` now that a percept was taken in."""
        self.probability, self.has_begun, self._ahead = probability, True, None

    def _move_on(self) -> Tensor:
        places, steps = self.probability.shape[1], self._chances.shape[2] - 1
        beyond = torch.nn.functional.pad(self.probability, (steps, steps))
        # Every place's share of those up to `steps` before it: a convolution in each episode.
        before = beyond.unfold(1, places + steps, 1).contiguous()  # [E, K, P + steps]
        ahead = torch.bmm(self._chances, before)[:, 0]
        ahead[:, places - 1] = ahead[:, places - 1 :].sum(dim=1)  # at its end an episode stays
        return ahead[:, :places] / ahead[:, :places].sum()

    def of_episodes(self) -> Tensor:
        """The probability of each known episode, `[E]`."""
        return self.probability.sum(dim=1)
