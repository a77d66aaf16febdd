"""Other packages that learn maps, each set up for one pass over the same stream.

Every `prepare_*` makes a new map, untimed, and returns the run and the map's size afterwards.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Run(NamedTuple):
    """One prepared pass over a stream."""

    learn: Callable[[], object]
    size: Callable[[], int]
    """Return the number of nodes after learning."""


class Peer(NamedTuple):
    """A package that learns a map."""

    module: str
    does: str
    prepare: Callable[[np.ndarray, int], Run]
    """Take the percepts `[T, D]` and the wanted number of nodes."""
    grows: bool

    @property
    def installed(self) -> bool:
        """Return whether the package is installed."""
        return importlib.util.find_spec(self.module) is not None


def grid(nodes: int) -> tuple[int, int]:
    """Return rows and columns of a nearly square grid of about `nodes` nodes."""
    rows = round(math.sqrt(nodes))
    return rows, round(nodes / rows)


def prepare_minisom(percepts: np.ndarray, nodes: int) -> Run:
    """Prepare MiniSom: its online rule, in the order of the stream."""
    from minisom import MiniSom

    rows, columns = grid(nodes)
    som = MiniSom(rows, columns, percepts.shape[1], random_seed=0)
    return Run(lambda: som.train(percepts, len(percepts)), lambda: rows * columns)


def prepare_numbasom(percepts: np.ndarray, nodes: int) -> Run:
    """Prepare numbasom: its online rule, on as many samples as the stream, drawn by itself."""
    from numbasom import SOM

    som = SOM(grid(nodes))

    def learn() -> None:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints its duration
            som.train(percepts, len(percepts))

    return Run(learn, lambda: math.prod(grid(nodes)))


def prepare_fastersom(percepts: np.ndarray, nodes: int) -> Run:
    """Prepare fastersom: one epoch of the batch map, including the final labels of `fit`."""
    from fastersom import SOM

    rows, columns = grid(nodes)
    som = SOM(rows, columns, n_epochs=1, init="sample", random_state=0, device="cpu")
    return Run(lambda: som.fit(percepts), lambda: rows * columns)


def prepare_minigng(percepts: np.ndarray, nodes: int) -> Run:
    """Prepare minigng: growing neural gas, full-sized after half of the stream."""
    from minigng import MiniGNG

    np.random.seed(0)  # noqa: NPY002  # its only source of randomness
    interval = max(1, len(percepts) // (2 * nodes))
    gng = MiniGNG(n_epochs=1, sigma=interval, max_units=nodes, shuffle=False)
    return Run(lambda: gng.partial_fit(percepts), lambda: len(gng.units))


PEERS = {
    "minigng": Peer(
        "minigng", "growing neural gas in numpy, online, in order", prepare_minigng, True
    ),
    "MiniSom": Peer("minisom", "fixed grid in numpy, online, in order", prepare_minisom, False),
    "numbasom": Peer(
        "numbasom",
        "fixed grid in numba, online, on samples that it draws itself",
        prepare_numbasom,
        False,
    ),
    "fastersom": Peer(
        "fastersom",
        "fixed grid in torch, one batch epoch: no online learning",
        prepare_fastersom,
        False,
    ),
}
