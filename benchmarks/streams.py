"""Streams of percepts for the measurements: seeded demonstrations on smooth loops.

Each behaviour is a closed path through via points. A demonstration is one lap of a random path, at
a random pace, with slightly displaced via points and noise. The stream is ordered in time, and no
two laps are equal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pacnet import SOFMConfig

N_VIA = 8  # of one behaviour
LAP = 250  # samples of a demonstration, on average
PACE = 0.2  # largest relative deviation of a lap's length
DISPLACEMENT = 0.05  # standard deviation of a via point from lap to lap; the points lie in [0, 1]
NOISE = 0.02  # standard deviation of every perceived number


class Case(NamedTuple):
    """A stream to observe, and the thresholds that give about `nodes` nodes."""

    samples: int
    dimensions: int
    behaviours: int
    nodes: int  # approximate number at the end
    paper_threshold: float  # novelty threshold of the preset `paper`
    gwr_threshold: float

    @property
    def title(self) -> str:
        """Return samples, dimensions and nodes in words."""
        return f"{self.samples:,} × {self.dimensions}, about {self.nodes:,} nodes"

    def config(self, preset: str) -> SOFMConfig:
        """Return the preset's config with this case's threshold."""
        if preset == "paper":
            return SOFMConfig.paper(self.dimensions, novelty_threshold=self.paper_threshold)
        return SOFMConfig.gwr(self.dimensions, novelty_threshold=self.gwr_threshold)

    def stream(self, seed: int = 0) -> np.ndarray:
        """Return the percepts, float32 `[samples, dimensions]`."""
        return demonstrations(self.samples, self.dimensions, self.behaviours, seed)


CASES = {
    "small": Case(2_500, 28, 1, 50, 0.629, 0.641),
    "long": Case(30_000, 6, 1, 100, 0.805, 0.811),
    "large": Case(100_000, 32, 20, 1_000, 0.635, 0.623),
}


def demonstrations(samples: int, dimensions: int, behaviours: int, seed: int) -> np.ndarray:
    """Return percepts of consecutive demonstrations, float32 `[samples, dimensions]`."""
    rng = np.random.default_rng(seed)
    paths = rng.random((behaviours, N_VIA, dimensions))
    laps, count = [], 0
    while count < samples:
        lap = _lap(paths[rng.integers(behaviours)], rng)
        laps.append(lap)
        count += len(lap)
    stream = np.concatenate(laps)[:samples]
    return (stream + NOISE * rng.standard_normal(stream.shape)).astype(np.float32)


def _lap(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return one lap `[T, D]`, from via point to via point with a minimum-jerk profile."""
    via = path + DISPLACEMENT * rng.standard_normal(path.shape)
    length = round(LAP * (1 + PACE * rng.uniform(-1, 1)))
    phase = np.arange(length) / length * N_VIA
    leg = phase.astype(int)
    s = phase - leg
    progress = s**3 * (10 - 15 * s + 6 * s**2)
    return via[leg] + progress[:, None] * (via[(leg + 1) % N_VIA] - via[leg])
