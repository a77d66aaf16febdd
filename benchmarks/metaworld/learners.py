"""All learners by name: the imitator, then the baselines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from benchmarks.metaworld import baselines
from benchmarks.metaworld.features import Array
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.imitator import Imitator

OPTIONS: dict[str, Any] = {}
"""Keywords of `Imitator.from_demonstrations`, as the options of `pacnet fit`: all automatic."""


class Learner(Protocol):
    """Learns from demonstrations, then acts on one percept after the other."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Learn once, from nothing."""
        ...

    def reset(self) -> None:
        """Start an episode."""
        ...

    def act(self, percept: Array) -> Array | None:
        """Return the action `[4]` at a percept `[D]`, float32; None to hold."""
        ...


class Imitating:
    """`pacnet.Imitator` with its automatic settings."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Make an imitator and let it learn."""
        self.imitator = Imitator.from_demonstrations(demonstrations, **OPTIONS)
        self.imitator.learn(demonstrations)

    def reset(self) -> None:
        """Start an episode."""
        self.imitator.reset()

    def act(self, percept: Array) -> Array | None:
        """Return its action, None where the percept is novel."""
        return self.imitator.step(np.asarray(percept, np.float32)).action


LEARNERS: dict[str, Callable[[], Learner]] = {
    "pacnet": Imitating,
    "nearest": baselines.Nearest,
    "replay": baselines.Replay,
    "local": baselines.LocalRegression,
    "bc": baselines.BehaviourCloning,
    "darp": baselines.NeighbourDifferences,
}
TITLES = {
    "pacnet": "`Imitator`",
    "nearest": "1-NN",
    "replay": "replay",
    "local": "local regression",
    "bc": "BC",
    "darp": "DARP-like",
}
"""Name -> how tables call it."""
