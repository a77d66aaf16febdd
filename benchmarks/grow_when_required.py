"""A plain Grow-When-Required network in numpy, vectorised over nodes, for comparison.

Source: Marsland, Shapiro & Nehmzow (2002), "A self-organising network that grows when required".
It learns like the preset `gwr` of `pacnet.SOFMConfig`.
"""

from __future__ import annotations

import numpy as np

from pacnet import SOFMConfig

NO_EDGE = -1


class GrowWhenRequired:
    """Learns percepts one after the other.

    Args:
        config: Of the preset `gwr`, with unit scale.
    """

    def __init__(self, config: SOFMConfig) -> None:
        self.config = config
        self.farthest = -np.log(config.novelty_threshold)  # largest distance of a match
        self.decays = config.decay(config.winner_tau), config.decay(config.neighbour_tau)
        self.count = 0
        self._prototypes = np.empty((16, config.dimensions), np.float32)
        self._habituation = np.empty(16, np.float32)
        self._ages = np.full((16, 16), NO_EDGE)

    @property
    def prototypes(self) -> np.ndarray:
        """Return the nodes, float32 `[N, D]`."""
        return self._prototypes[: self.count]

    def learn(self, percepts: np.ndarray) -> None:
        """Learn a stream, float32 `[T, D]`."""
        for percept in percepts:
            self._step(percept)

    def _step(self, percept: np.ndarray) -> None:
        if self.count == 0:
            self._add(percept)
            return
        difference = percept - self._prototypes[: self.count]
        squared = np.einsum("nd,nd->n", difference, difference)
        winner = int(squared.argmin())
        distance = squared[winner] ** 0.5
        squared[winner] = np.inf
        runner_up = int(squared.argmin()) if self.count > 1 else None
        habituated = self._habituation[winner] < self.config.habituated_below
        if distance > self.farthest and habituated:
            self._insert(percept, winner, runner_up)
        else:
            self._join(winner, runner_up, 0)
            self._adapt(winner, difference)
            self._prune(winner)

    def _insert(self, percept: np.ndarray, winner: int, runner_up: int | None) -> None:
        node = self._add((self._prototypes[winner] + percept) / 2)
        self._join(node, winner, 0)
        self._join(node, runner_up, 0)
        self._join(winner, runner_up, NO_EDGE)

    def _adapt(self, winner: int, difference: np.ndarray) -> None:
        """Move the winner and its neighbours, then habituate them."""
        config = self.config
        neighbours = np.flatnonzero(self._ages[winner, : self.count] != NO_EDGE)
        steps = config.neighbour_rate * self._habituation[neighbours]
        self._prototypes[neighbours] += steps[:, None] * difference[neighbours]
        step = config.winner_rate * self._habituation[winner]
        self._prototypes[winner] += step * difference[winner]
        floor, (winner_decay, neighbour_decay) = config.floor_habituation, self.decays
        self._habituation[winner] = floor + (self._habituation[winner] - floor) * winner_decay
        rest = self._habituation[neighbours] - floor
        self._habituation[neighbours] = floor + rest * neighbour_decay
        self._ages[winner, neighbours] += 1
        self._ages[neighbours, winner] += 1

    def _prune(self, winner: int) -> None:
        """Delete the winner's old edges, then nodes without any."""
        old = np.flatnonzero(self._ages[winner, : self.count] > self.config.max_edge_age)
        if len(old) == 0:
            return
        self._ages[winner, old] = self._ages[old, winner] = NO_EDGE
        isolated = old[(self._ages[old] == NO_EDGE).all(axis=1)]
        if len(isolated) == 0:
            return
        kept = np.setdiff1d(np.arange(self.count), isolated)
        self._prototypes[: len(kept)] = self._prototypes[kept]
        self._habituation[: len(kept)] = self._habituation[kept]
        ages = self._ages[np.ix_(kept, kept)]
        self._ages[:] = NO_EDGE
        self._ages[: len(kept), : len(kept)] = ages
        self.count = len(kept)

    def _add(self, prototype: np.ndarray) -> int:
        if self.count == len(self._prototypes):
            self._grow()
        self._prototypes[self.count] = prototype
        self._habituation[self.count] = self.config.resting_habituation
        self.count += 1
        return self.count - 1

    def _grow(self) -> None:
        grown = 2 * self.count
        self._prototypes = np.resize(self._prototypes, (grown, self.config.dimensions))
        self._habituation = np.resize(self._habituation, grown)
        ages = np.full((grown, grown), NO_EDGE)
        ages[: self.count, : self.count] = self._ages
        self._ages = ages

    def _join(self, one: int, other: int | None, age: int) -> None:
        if other is not None:
            self._ages[one, other] = self._ages[other, one] = age
