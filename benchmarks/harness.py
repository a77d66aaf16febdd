"""What the measurements share: tables, and the timing of interleaved runs."""

from __future__ import annotations

import argparse
import gc
import importlib
import json
import statistics
import textwrap
import time
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np
import torch

NOTHING = "–"  # cell without a value

Candidate = Callable[[], Callable[[], object]]
"""Prepares a run, untimed, and returns the function that runs it."""


class Table(NamedTuple):
    """One table of the page."""

    title: str
    text: str
    """A paragraph that says what was measured and how; it is wrapped anew."""
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def __str__(self) -> str:
        """Return the table as a section of Markdown, with columns aligned for a terminal too."""
        lines = [self.columns, *self.rows]
        widths = [max(3, *map(len, column)) for column in zip(*lines, strict=True)]
        drawn = [_line(line, widths) for line in lines]
        rule = "|".join(["", "-" * (widths[0] + 2), *("-" * (w + 1) + ":" for w in widths[1:]), ""])
        text = textwrap.fill(" ".join(self.text.split()), 100, break_on_hyphens=False)
        return "\n".join([f"## {self.title}", "", text, "", drawn[0], rule, *drawn[1:]])


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    aligned = [cells[0].ljust(widths[0])]
    aligned += [cell.rjust(width) for cell, width in zip(cells[1:], widths[1:], strict=True)]
    return "| " + " | ".join(aligned) + " |"


def median_times(
    candidates: Mapping[str, Candidate], budget: float = 2.0, most: int = 25
) -> dict[str, float]:
    """Return the median time of each candidate [s].

    Runs are interleaved in one process, so background load affects all alike.

    Args:
        candidates: Name -> candidate.
        budget: Time after which a candidate is not run again [s].
        most: Runs of each candidate.
    """
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(most):
        for name, prepare in candidates.items():
            if sum(times[name]) < budget:
                times[name].append(timed(prepare()))
    return {name: statistics.median(measured) for name, measured in times.items()}


def timed(run: Callable[[], object]) -> float:
    """Return the time of one run [s]."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def latencies(step: Callable[[np.ndarray], object], inputs: Iterable[np.ndarray]) -> np.ndarray:
    """Return the time of each single call `[T]` [µs], as in a control loop."""
    clock, times = time.perf_counter_ns, []
    gc.collect()
    for one in inputs:
        start = clock()
        step(one)
        times.append(clock() - start)
    return np.array(times) / 1e3


def number(value: float) -> str:
    """Return a measured value with about three digits."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.2f}" if value < 10 else f"{value:.1f}"


def factor(value: float) -> str:
    """A ratio, as in `2.4 ×`."""
    return number(value) + " ×"


def run_alone(description: str, measure: Callable[[], list[Table]]) -> None:
    """Measure and print the tables of one module."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.parse_args()
    torch.set_num_threads(1)
    print("\n\n".join(str(table) for table in measure()))


def write_json(module: str, path: str) -> None:
    """Write a module's tables as JSON to a file, for `python -m benchmarks`."""
    torch.set_num_threads(1)
    tables = importlib.import_module(f"benchmarks.{module}").measure()
    with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123
        json.dump([table._asdict() for table in tables], file)
