"""The peers that the package index offers, each brought to one pass over the same stream.

Every `prepare_*` makes a fresh map, untimed, and returns the run and the map's size afterwards.
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
    """Number of nodes, once learned."""


class Peer(NamedTuple):
    """A package that learns a map."""

    module: str
    does: str
    prepare: Callable[[np.ndarray, int], Run]
    """From the percepts `[T, D]` and the wanted number of nodes."""
    grows: bool

    @property
    def installed(self) -> bool:
        """Whether the package is here."""
        return importlib.util.find_spec(self.module) is not None


def grid(nodes: int) -> tuple[int, int]:
    """Rows and columns of a nearly square grid of about so many nodes."""
    rows = round(math.sqrt(nodes))
    return rows, round(nodes / rows)


def prepare_minisom(percepts: np.ndarray, nodes: int) -> Run:
    """MiniSom: its online rule, in the order of the stream."""
    from minisom import MiniSom

    rows, columns = grid(nodes)
    som = MiniSom(rows, columns, percepts.shape[1], random_seed=0)
    return Run(lambda: som.train(percepts, len(percepts)), lambda: rows * columns)


def prepare_numbasom(percepts: np.ndarray, nodes: int) -> Run:
    """numbasom: its online rule, on as many samples as the stream has, which it draws itself."""
    from numbasom import SOM

    som = SOM(grid(nodes))

    def learn() -> None:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints how long it took
            som.train(percepts, len(percepts))

    return Run(learn, lambda: math.prod(grid(nodes)))


def prepare_fastersom(percepts: np.ndarray, nodes: int) -> Run:
    """fastersom: one epoch of the batch map, and the labels that `fit` ends with."""
    from fastersom import SOM

    rows, columns = grid(nodes)
    som = SOM(rows, columns, n_epochs=1, init="sample", random_state=0, device="cpu")
    return Run(lambda: som.fit(percepts), lambda: rows * columns)


def prepare_minigng(percepts: np.ndarray, nodes: int) -> Run:
    """minigng: growing neural gas, which has grown to the wanted size after half the stream."""
    from minigng import MiniGNG

    np.random.seed(0)  # noqa: NPY002  its only source of randomness
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
