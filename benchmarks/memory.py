"""Resident memory over ten million samples from a generator: `python -m benchmarks.memory`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from benchmarks.harness import NOTHING, Table, number, run_alone, timed
from benchmarks.streams import demonstrations
from pacnet import HabituatingSOFM, SOFMConfig

SAMPLES, CHUNK, PARTS = 10_000_000, 50_000, 10
DIMENSIONS, THRESHOLD = 6, 0.7
WANTED = 5  # largest growth from the first tenth to the last [MB]
STATUS = Path("/proc/self/statm")  # in pages; the second number is the resident ones

TEXT = f"""{SAMPLES:,} percepts of {DIMENSIONS} dimensions, generated in chunks of {CHUNK:,}, each
chunk learned by one `observe` (preset `paper`, whose nodes forget after 10,000 samples).
"""


def chunks(samples: int, seed: int = 0) -> Iterator[np.ndarray]:
    """Yield the same demonstrations with new noise each time, float32 `[CHUNK, D]`."""
    rng = np.random.default_rng(seed)
    stream = demonstrations(CHUNK, DIMENSIONS, 2, seed)
    for _ in range(samples // CHUNK):
        yield stream + 0.02 * rng.standard_normal(stream.shape, np.float32)


def resident() -> float:
    """Return the resident memory of this process [MB]."""
    import resource

    return int(STATUS.read_text().split()[1]) * resource.getpagesize() / 1e6


def measure() -> list[Table]:
    """Measure one row for each tenth of the samples."""
    columns = (
        "samples",
        "resident memory [MB]",
        "since the first tenth [MB]",
        "wanted",
        "nodes",
        "µs a sample",
    )
    title = "Memory over ten million samples"
    if not STATUS.exists():
        return [Table(title, TEXT, columns, [("needs Linux's /proc", *[NOTHING] * 5)])]
    som = HabituatingSOFM(
        SOFMConfig.paper(DIMENSIONS, novelty_threshold=THRESHOLD), engine="compiled"
    )
    source = chunks(SAMPLES)
    som.observe(torch.from_numpy(next(chunks(CHUNK))))
    rows, first = [("0", number(resident()), NOTHING, NOTHING, f"{len(som)}", NOTHING)], 0.0
    for part in range(1, PARTS + 1):
        learning = 0.0
        for _ in range(SAMPLES // CHUNK // PARTS):
            percepts = torch.from_numpy(next(source))
            learning += timed(lambda percepts=percepts: som.observe(percepts))
        now = resident()
        first = first or now
        wanted = f"≤ {WANTED}" if part == PARTS else NOTHING
        cost = number(learning / (SAMPLES / PARTS) * 1e6)
        grown = NOTHING if part == 1 else f"{now - first:+.1f}"
        rows.append(
            (f"{SAMPLES // PARTS * part:,}", number(now), grown, wanted, f"{len(som)}", cost)
        )
    return [Table(title, TEXT, columns, rows)]


if __name__ == "__main__":
    run_alone(__doc__, measure)
