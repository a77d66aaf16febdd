"""Rules that choose which frames of a stream are kept, all within the same budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pacnet import HabituatingSOFM, SOFMConfig
from pacnet.attention.records import Observation
from train.postural.learning import WINNER_TAU
from train.remembering.clusters import batch_means, nearest_frames, online_means

Numbers = NDArray[np.int64]

_TRIED = 12  # novelty thresholds, to fill the budget with nodes
_AT_ONCE = 1e-9  # rate at which nodes that never move do
_WINDOW = 25  # frames of which means are compared to tell whether anything moves
_MOVES = 2.0  # of the distance that means differ by noise alone, from which something does


@dataclass(frozen=True, eq=False)
class Choice:
    """What a rule chooses from.

    Attributes:
        percepts: Of all demonstrations, in order, scaled `[N, 28]`.
        of: Number of the demonstration that each is of `[N]`.
        task: Number of the task that each shows `[N]`.
        budget: Number of frames that are kept, at most.
        seed: Of chance.
    """

    percepts: NDArray[np.float64]
    of: Numbers
    task: Numbers
    budget: int
    seed: int

    @property
    def rng(self) -> np.random.Generator:
        """Return a source of chance."""
        return np.random.default_rng(self.seed)

    @property
    def last(self) -> Numbers:
        """Return the frames of the last demonstration."""
        return np.flatnonzero(self.of == self.of[-1])


Rule = Callable[[Choice], Numbers]  # returns the numbers of the frames that are kept, ascending


def evenly(choice: Choice) -> Numbers:
    """Return every n-th frame."""
    return _evenly(len(choice.percepts), choice.budget)


def evenly_of_last(choice: Choice) -> Numbers:
    """Return every n-th frame of the last demonstration."""
    return choice.last[_evenly(len(choice.last), choice.budget)]


def moving_of_last(choice: Choice) -> Numbers:
    """Return every n-th moving frame of the last demonstration of each task, as many of each."""
    tasks, kept = np.unique(choice.task), []
    for task in tasks:
        own = np.flatnonzero(choice.of == choice.of[choice.task == task][-1])
        moves = moving(choice.percepts[own])
        frames = own[moves] if moves.any() else own
        kept.append(frames[_evenly(len(frames), choice.budget // len(tasks))])
    return np.sort(np.concatenate(kept))


def moving(percepts: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return at which frames the mean of those to come differs from that of those before `[N]`.

    Args:
        percepts: Of one demonstration `[N, 28]`.
    """
    moves = np.zeros(len(percepts), bool)  # at the ends it is not known
    if len(percepts) >= 2 * _WINDOW:
        means = sliding_window_view(percepts, _WINDOW, axis=0).mean(axis=2)
        apart = np.linalg.norm(means[_WINDOW:] - means[:-_WINDOW], axis=1)
        noise = np.median(np.linalg.norm(np.diff(percepts, axis=0), axis=1)) / np.sqrt(_WINDOW)
        moves[_WINDOW : _WINDOW + len(apart)] = apart > _MOVES * noise
    return moves


def at_random(choice: Choice) -> Numbers:
    """Return random frames, all equally likely: what a reservoir holds at the end of a stream."""
    return np.sort(choice.rng.permutation(len(choice.percepts))[: choice.budget])


def random_of_last(choice: Choice) -> Numbers:
    """Return random frames of the last demonstration."""
    return np.sort(choice.rng.permutation(choice.last)[: choice.budget])


def clusters(choice: Choice) -> Numbers:
    """Return the frames nearest to the means of batch k-means."""
    return nearest_frames(choice.percepts, batch_means(choice.percepts, choice.budget, choice.rng))


def clusters_online(choice: Choice) -> Numbers:
    """Return the frames nearest to the means of online k-means."""
    return nearest_frames(choice.percepts, online_means(choice.percepts, choice.budget))


def habituated(choice: Choice) -> Numbers:
    """Return the frame at which each node of the paper's map won last while it was habituated."""
    seen = _grow(choice, winner_tau=WINNER_TAU)
    return _last_of_each(seen, seen.ignored & ~seen.novelty)


def unhabituated(choice: Choice) -> Numbers:
    """Return the frame at which each node of a map won last that never habituates."""
    seen = _grow(choice, ignore_when_habituated=False)
    return _last_of_each(seen, ~seen.novelty | seen.inserted)


def novel(choice: Choice) -> Numbers:
    """Return the frames at which a map made nodes that never move: novelty alone."""
    seen = _grow(choice, winner_rate=_AT_ONCE, neighbour_rate=0.0)
    return np.flatnonzero(seen.inserted.numpy())


RULES: dict[str, Rule] = {
    "map with habituation": habituated,
    "map without habituation": unhabituated,
    "novelty alone": novel,
    "random frames (a reservoir)": at_random,
    "random, last demonstration": random_of_last,
    "every n-th frame": evenly,
    "every n-th, last demonstration": evenly_of_last,
    "every n-th moving, last of each": moving_of_last,
    "k-means": clusters,
    "k-means, online": clusters_online,
}


def _evenly(frames: int, budget: int) -> Numbers:
    few = min(frames, budget)
    return ((np.arange(few) + 0.5) * frames / few).astype(np.int64)


def _grow(choice: Choice, **fields: float | bool) -> Observation:
    """Return what a map did with the stream that has as many nodes as fit into the budget."""
    rows = torch.from_numpy(choice.percepts.astype(np.float32))
    low, high, best = 0.0, 1.0, None
    for _ in range(_TRIED):
        threshold = (low + high) / 2
        sofm = HabituatingSOFM(
            SOFMConfig.paper(rows.shape[1], novelty_threshold=threshold, **fields)
        )
        seen = sofm.observe(rows)
        if len(sofm) <= choice.budget and int(seen.deleted.sum()) == 0:
            low, best = threshold, seen
        else:
            high = threshold
    assert best is not None  # a threshold near 0 makes a single node
    return best


def _last_of_each(seen: Observation, counts: torch.Tensor) -> Numbers:
    """Return the last sample that counts at each node, which it won or which made it."""
    made = seen.inserted.cumsum(0) - 1  # no node was deleted, so they are numbered in order
    node = torch.where(seen.inserted, made, seen.winner)
    samples = counts.nonzero().flatten()
    last = dict(zip(node[samples].tolist(), samples.tolist(), strict=True))
    return np.sort(np.array([*last.values()], np.int64))
