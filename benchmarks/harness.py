"""What the measurements share: tables, and contestants that take turns under the clock."""

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

NOTHING = "–"  # stands in a cell that has no value

Contestant = Callable[[], Callable[[], object]]
"""Calling one prepares a run, untimed; calling what it returns is the run."""


class Table(NamedTuple):
    """One table of the page."""

    title: str
    text: str
    """What was measured and how: a paragraph, whose line breaks do not count."""
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def __str__(self) -> str:
        """The table as a section of Markdown, in columns that also line up in a terminal."""
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


def race(
    contestants: Mapping[str, Contestant], budget: float = 2.0, most: int = 25
) -> dict[str, float]:
    """Median time of each [s]; they take turns, so that a busy machine slows all of them alike.

    Args:
        contestants: by name.
        budget: a contestant runs no more once its runs have taken this long together [s].
        most: runs of each.
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(most):
        for name, prepare in contestants.items():
            if sum(times[name]) < budget:
                times[name].append(timed(prepare()))
    return {name: statistics.median(measured) for name, measured in times.items()}


def timed(run: Callable[[], object]) -> float:
    """Time of one run [s]."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def latencies(step: Callable[[np.ndarray], object], inputs: Iterable[np.ndarray]) -> np.ndarray:
    """Time of each single call [µs], `[T]`, as a control loop sees it."""
    clock, times = time.perf_counter_ns, []
    gc.collect()
    for one in inputs:
        start = clock()
        step(one)
        times.append(clock() - start)
    return np.array(times) / 1e3


def number(value: float) -> str:
    """A measured value with about three digits."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.2f}" if value < 10 else f"{value:.1f}"


def factor(value: float) -> str:
    """A ratio, as in `2.4 ×`."""
    return number(value) + " ×"


def run_alone(description: str, measure: Callable[[], list[Table]]) -> None:
    """The command of one module: measures and prints its tables."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.parse_args()
    torch.set_num_threads(1)
    print("\n\n".join(str(table) for table in measure()))


def hand_over(module: str, path: str) -> None:
    """Measures a module's tables and leaves them as JSON in a file, for `python -m benchmarks`."""
    torch.set_num_threads(1)
    tables = importlib.import_module(f"benchmarks.{module}").measure()
    with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123  one line in a child process
        json.dump([table._asdict() for table in tables], file)
