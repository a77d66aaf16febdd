"""Learning with more and more nodes, compared with the bandwidth of the memory.

Run it alone with `python -m benchmarks.nodes`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from benchmarks import floor
from benchmarks.harness import NOTHING, Candidate, Table, factor, median_times, number, run_alone
from pacnet import HabituatingSOFM, SOFMConfig

DIMENSIONS = 32
SAMPLES = {1_000: 20_000, 10_000: 4_000, 100_000: 400}  # for each number of nodes
NEAR = 0.02  # standard deviation of a sample around its node; nodes lie in [0, 1]
ROW = 4 * DIMENSIONS  # bytes of a prototype

TEXT = f"""Every sample lies near one of the nodes, is learned by it and its neighbours, and adds no
node (preset `gwr`, {DIMENSIONS} dimensions, one thread). Finding the winner reads each prototype
once. For comparison, the last column shows how fast a C loop reads the same number of bytes
repeatedly, in the same run.
"""


def full_map(nodes: int, seed: int = 0) -> HabituatingSOFM:
    """Return a map of random nodes, loaded as from a checkpoint."""
    som = HabituatingSOFM(SOFMConfig.gwr(DIMENSIONS, novelty_threshold=0.1), engine="compiled")
    generator = torch.Generator().manual_seed(seed)
    state = {
        "nodes.prototype": torch.rand(nodes, DIMENSIONS, generator=generator),
        "nodes.habituation": torch.ones(nodes),
        "nodes.habituated_at": torch.full((nodes,), -1),
        "edges.ends": torch.empty(0, 2, dtype=torch.int64),
        "edges.age": torch.empty(0, dtype=torch.int64),
        "time": torch.tensor(0),
    }
    som.load_state_dict(state)
    return som


def samples_near(som: HabituatingSOFM, samples: int, seed: int = 1) -> torch.Tensor:
    """Return percepts near random nodes `[samples, D]`."""
    generator = torch.Generator().manual_seed(seed)
    near = som.prototypes[torch.randint(len(som), (samples,), generator=generator)]
    return near + NEAR * torch.randn(near.shape, generator=generator)


def _learning(nodes: int) -> Candidate:
    def prepare() -> Callable[[], object]:
        som = full_map(nodes)
        percepts = samples_near(som, SAMPLES[nodes])
        som.observe(percepts[:2])
        return lambda: som.observe(percepts)

    return prepare


def _reading(nodes: int, times: int) -> Candidate:
    built = floor.build()
    assert built is not None
    numbers = _aligned(nodes * DIMENSIONS)

    def prepare() -> Callable[[], object]:
        return lambda: built.read(numbers, times)

    return prepare


def _aligned(count: int) -> np.ndarray:
    """Return float32 ones whose address is a multiple of 64 bytes."""
    memory = np.ones(count + 16, np.float32)
    first = (-memory.ctypes.data % 64) // 4
    return memory[first : first + count]


def measure() -> list[Table]:
    """Measure one row for each number of nodes."""
    candidates = {f"learn {nodes}": _learning(nodes) for nodes in SAMPLES}
    if floor.build() is not None:
        candidates |= {f"read {nodes}": _reading(nodes, SAMPLES[nodes]) for nodes in SAMPLES}
    times = median_times(candidates, budget=5, most=9)
    cost = {name: time / SAMPLES[int(name.split()[1])] * 1e6 for name, time in times.items()}
    first = next(iter(SAMPLES))
    rows = [_row(nodes, first, cost) for nodes in SAMPLES]
    columns = (
        "nodes",
        "µs a sample",
        "times the first row",
        "wanted",
        "MB read",
        "GB/s",
        "GB/s of the C loop",
    )
    return [Table("From 1,000 to 100,000 nodes", TEXT, columns, rows)]


def _row(nodes: int, first: int, cost: dict[str, float]) -> tuple[str, ...]:
    learn, read = cost[f"learn {nodes}"], cost.get(f"read {nodes}")
    return (
        f"{nodes:,}",
        number(learn),
        factor(learn / cost[f"learn {first}"]),
        NOTHING if nodes == first else f"≤ {nodes // first} ×",
        number(nodes * ROW / 1e6),
        number(nodes * ROW / learn / 1e3),
        "no C compiler" if read is None else number(nodes * ROW / read / 1e3),
    )


if __name__ == "__main__":
    run_alone(__doc__, measure)
