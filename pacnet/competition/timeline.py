"""The timeline of the known episodes: the percept expected in each state of each.

An episode is divided into equal parts, the states of a chain.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.schemas.memory import EpisodicMemory
from pacnet.schemas.sequences import rows_of


class Timeline(NamedTuple):
    """E known episodes of P states each."""

    rows: NDArray[np.int64]
    """Row of the pool whose cue is expected in each state, int64 `[E, P]`."""
    episode: NDArray[np.int64]
    """Row of each episode in memory, int64 `[E]`."""
    advance: NDArray[np.float64]
    """Probability that one sample takes the episode on by 0, 1, … states, `[E, K]`."""
    start: NDArray[np.float64]
    """The belief before the first sample, `[E, P]`; sums to 1."""


def build_timeline(memory: EpisodicMemory, n_states: int) -> Timeline:
    """Return the timeline of all episodes that still have a schema.

    A state has the row whose time in the episode is nearest to its middle. The sequence of a schema
    that was shown in another episode is stretched to the time of this episode's visit.

    Args:
        memory: with at least one visit.
        n_states: P of each episode.
    """
    visit, time, row = shown_samples(memory)
    episode, samples = memory.visits.live("episode")[visit], memory.episodes.live("samples")
    at = (time + 0.5) / samples[episode] * n_states  # [S] in states
    state = at.floor().clamp(0, n_states - 1).long()
    filled, chosen = _nearest_in_time(episode * n_states + state, (at - state - 0.5).abs(), row)
    rows = torch.full((len(samples) * n_states,), -1, device=row.device)
    rows[filled] = chosen
    rows = rows.view(len(samples), n_states)
    known = (rows >= 0).any(dim=1).nonzero().flatten()
    behaviour = memory.episodes.live("behaviour")
    return make_timeline(_without_gaps(rows[known]), known, samples[known], behaviour[known])


def make_timeline(rows: Tensor, episode: Tensor, samples: Tensor, behaviour: Tensor) -> Timeline:
    """Return a timeline in which all behaviours are equally likely.

    Half of the prior lies on the first states, half on all states. `rows` and `episode` are those
    of `Timeline`; `samples` are the lengths of the episodes, `behaviour` their behaviours, `[E]`.
    """
    episodes, states = rows.shape
    rate = states / samples.double()  # [E] states per sample
    steps = torch.arange(math.ceil(float(rate.max()) * 3) + 3, device=rows.device)
    # Poisson, so that a demonstration may be faster or slower than the remembered one.
    advance = (steps * rate[:, None].log() - rate[:, None] - torch.lgamma(steps + 1.0)).exp()
    advance /= advance.sum(dim=1, keepdim=True)
    _, kind, count = behaviour.unique(return_inverse=True, return_counts=True)
    start = torch.full((episodes, states), 0.5 / states, dtype=torch.float64, device=rows.device)
    start[:, 0] += 0.5
    start *= (1 / count[kind].double())[:, None]
    fields = rows, episode, advance, start / start.sum()
    return Timeline(*(field.contiguous().numpy(force=True) for field in fields))


def shown_samples(memory: EpisodicMemory) -> tuple[Tensor, Tensor, Tensor]:
    """Return, of each sample of each visit: the visit's row, its time [samples], its pool row."""
    visits = memory.visits
    schema = visits.live("schema")
    lengths, starts = memory.lengths[schema], memory.blocks.live("start")[schema]
    visit = torch.repeat_interleave(torch.arange(len(visits), device=schema.device), lengths)
    row = rows_of(starts, lengths)
    frame = memory.pool.live("frame")
    begin, end = frame[starts][visit], frame[starts + lengths - 1][visit]
    share = (frame[row] - begin) / (end - begin).clamp(min=1)
    first, last = visits.live("first")[visit], visits.live("last")[visit]
    return visit, first + share * (last - first), row


def _nearest_in_time(state: Tensor, distance: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Return the states that have a row, and for each the row nearest to its middle."""
    order = distance.argsort(stable=True)
    order = order[state[order].argsort(stable=True)]
    state, row = state[order], row[order]
    first = torch.ones_like(state, dtype=torch.bool)
    first[1:] = state[1:] != state[:-1]
    return state[first], row[first]


def _without_gaps(rows: Tensor) -> Tensor:
    """Return rows `[E, P]` in which each −1 is replaced by the row of the nearest state."""
    states = torch.arange(rows.shape[1], device=rows.device).expand_as(rows)
    nowhere = 2 * rows.shape[1]
    before = states.where(rows >= 0, -nowhere).cummax(dim=1).values
    after = states.where(rows >= 0, nowhere).flip(1).cummin(dim=1).values.flip(1)
    nearest = before.where(states - before <= after - states, after)
    return rows.gather(1, nearest)
