"""The nearest and second nearest nodes of many percepts at once, compared with faiss.

Run it alone with `python -m benchmarks.batch`.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable

import numpy as np
import torch

from benchmarks.harness import NOTHING, Table, factor, median_times, number, run_alone
from benchmarks.nodes import DIMENSIONS, full_map

QUERIES, NODES, CHUNK = 100_000, 1_000, 4_096
TORCH_CHUNK = 1_024  # `topk` is fastest with this size
PACNET, NUMPY, TORCH, FAISS = "pacnet `forward`", "numpy", "torch", "faiss"
DOES = {
    PACNET: "winner, runner-up, activation and novelty",
    FAISS: "`IndexFlatL2.search`, k = 2",
    NUMPY: "matrix product and two `argmin`, in chunks",
    TORCH: "`addmm` and `topk`, in chunks",
}

TEXT = f"""{QUERIES:,} percepts of {DIMENSIONS} dimensions against {NODES:,} nodes, uniformly
random, all float32. Threads are set by `torch.set_num_threads` for pacnet and torch and by
`faiss.omp_set_num_threads` for faiss; numpy's matrix product always uses one thread
(`OMP_NUM_THREADS=1`). An earlier version with hand-written vector instructions was faster than
faiss (0.75 ×); plain numba is slower.
"""


def numpy_two_nearest(queries: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return winners and runners-up: |w|² − 2xw orders nodes as the distance does."""
    half = (nodes**2).sum(axis=1) / 2
    found = []
    for start in range(0, len(queries), CHUNK):
        nearness = half - queries[start : start + CHUNK] @ nodes.T
        winner = nearness.argmin(axis=1)
        nearness[np.arange(len(winner)), winner] = np.inf
        found.append((winner, nearness.argmin(axis=1)))
    winners, runners_up = zip(*found, strict=True)
    return np.concatenate(winners), np.concatenate(runners_up)


def torch_two_nearest(queries: torch.Tensor, nodes: torch.Tensor) -> torch.Tensor:
    """Return winners and runners-up `[B, 2]`, by |w|² − 2xw too: `cdist` is slower."""
    squares = nodes.square().sum(dim=1)
    found = []
    for part in queries.split(TORCH_CHUNK):
        nearness = torch.addmm(squares, part, nodes.T, alpha=-2)  # [B, N]
        found.append(nearness.topk(2, largest=False)[1])
    return torch.cat(found)


def searches() -> dict[str, Callable[[], object]]:
    """Return name -> search; without faiss if it is not installed."""
    som = full_map(NODES)
    queries = torch.rand(QUERIES, DIMENSIONS, generator=torch.Generator().manual_seed(1))
    nodes = som.prototypes
    found: dict[str, Callable[[], object]] = {
        PACNET: lambda: som(queries),
        NUMPY: lambda: numpy_two_nearest(queries.numpy(), nodes.numpy()),
        TORCH: lambda: torch_two_nearest(queries, nodes),
    }
    if importlib.util.find_spec("faiss"):
        import faiss

        index = faiss.IndexFlatL2(DIMENSIONS)
        index.add(nodes.numpy())
        found[FAISS] = lambda: index.search(queries.numpy(), 2)
    return found


def _use_threads(threads: int) -> None:
    torch.set_num_threads(threads)
    if importlib.util.find_spec("faiss"):
        import faiss

        faiss.omp_set_num_threads(threads)


def measure_threads(threads: int) -> Table:
    """Measure the table for one number of threads."""
    _use_threads(threads)
    found = searches()
    for search in found.values():
        search()
    times = median_times(
        {name: lambda search=search: search for name, search in found.items()}, budget=4
    )
    rows = [_row(name, times) for name in DOES]
    title = f"A batch of {QUERIES:,} percepts, {threads} thread{'s' * (threads > 1)}"
    return Table(title, TEXT, ("who", "µs a query", "of faiss", "wanted"), rows)


def _row(name: str, times: dict[str, float]) -> tuple[str, ...]:
    who = f"{name}: {DOES[name]}"
    if name not in times:
        return who, "not installed", NOTHING, NOTHING
    of_faiss = factor(times[name] / times[FAISS]) if FAISS in times else NOTHING
    wanted = "≤ 1 ×" if name == PACNET else NOTHING
    return who, number(times[name] / QUERIES * 1e6), of_faiss, wanted


def measure() -> list[Table]:
    """Measure with one thread, and with all."""
    return [measure_threads(threads) for threads in sorted({1, os.cpu_count() or 1})]


if __name__ == "__main__":
    run_alone(__doc__, measure)
