"""A control loop that goes on while another thread learns: `python -m benchmarks.acting`."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from itertools import cycle, islice
from typing import NamedTuple

import numpy as np

from benchmarks.harness import NOTHING, Table, latencies, number, run_alone
from benchmarks.step import DIMENSIONS, JOINTS, LENGTH, SHOWN, imitator, laps
from pacnet.demonstrations import Demonstrations
from pacnet.imitator import Imitator

RATE = 500  # of the steady control loop [1/s]
STEADY, BUSY = 5_000, 20_000  # steps of each kind of loop
LESSONS, SHORT = 200, 50  # demonstrations that are learned meanwhile, and frames of each
WANTED = 5  # [ms], of all but one step in a thousand

TEXT = f"""`Imitator.step` by an imitator of {SHOWN} demonstrations of {LENGTH} frames, {DIMENSIONS}
dimensions and {JOINTS} actions. Beside it another thread of the same process lets a copy of the
imitator learn {LESSONS} demonstrations of {SHORT} frames, one call of `Imitator.learn` each, and
begins anew with another copy when it is through: {{learned:,}} were learned meanwhile.
The steady loop takes {STEADY:,} steps at {RATE} a second and sleeps in between, the busy one
{BUSY:,} without a pause. A step's time is that of the call; «from when it was due» adds what the
loop woke up late. Everything was compiled before. One thread each, and one interpreter: each has
to wait until the other lets go of it.
"""


class Learning:
    """A thread that learns demonstrations for as long as it is wanted.

    Attributes:
        learned: number of demonstrations learned so far.
    """

    def __init__(self, taught: Imitator, lessons: Demonstrations) -> None:
        self.learned = 0
        self._taught, self._lessons = deepcopy(taught), lessons  # the one acts, the copy is copied
        self._over = threading.Event()

    @contextmanager
    def beside(self) -> Iterator[None]:
        """Learns during the block; an error of the thread is raised at its end."""
        self._over.clear()
        with ThreadPoolExecutor(1) as pool:
            learning = pool.submit(self._learn)
            try:
                yield
            finally:
                self._over.set()
            learning.result()

    def _learn(self) -> None:
        while not self._over.is_set():
            learner = deepcopy(self._taught).train()
            for shown in self._lessons:
                learner.learn(replace(self._lessons, episodes=(shown,)))
                self.learned += 1
                if self._over.is_set():
                    break


class Steady(NamedTuple):
    """Times of the steps of a steady loop, `[T]` each [µs]."""

    taken: np.ndarray
    """By the call."""
    since_due: np.ndarray
    """From when the step was due to its end."""


def steady(acting: Imitator, percepts: Iterator[np.ndarray], rate: float) -> Steady:
    """A control loop that steps so many times a second; one that is late does not hurry."""
    taken, since_due = [], []
    due = time.perf_counter()
    for percept in percepts:
        now = time.perf_counter()
        due = max(due + 1 / rate, now)
        time.sleep(due - now)
        start = time.perf_counter()
        acting.step(percept)
        end = time.perf_counter()
        taken.append(end - start)
        since_due.append(end - due)
    return Steady(np.array(taken) * 1e6, np.array(since_due) * 1e6)


def measure(steps: tuple[int, int] = (STEADY, BUSY), rate: float = RATE) -> list[Table]:
    """One row a kind of loop, alone and beside learning."""
    acting, watched = imitator("auto")
    lessons, _ = laps(LESSONS, SHORT)
    learning = Learning(acting, lessons)
    _warm(acting, watched, lessons)

    def percepts(count: int) -> Iterator[np.ndarray]:
        return islice(cycle(watched), count)

    alone = steady(acting, percepts(steps[0]), rate)
    busy_alone = latencies(acting.step, percepts(steps[1]))
    with learning.beside():
        beside = steady(acting, percepts(steps[0]), rate)
        busy_beside = latencies(acting.step, percepts(steps[1]))
    rows = [
        _row("steady, alone", alone.taken),
        _row("steady, beside learning", beside.taken, WANTED),
        _row("steady, alone, from when it was due", alone.since_due),
        _row("steady, beside learning, from when it was due", beside.since_due),
        _row("busy, alone", busy_alone),
        _row("busy, beside learning", busy_beside, WANTED),
    ]
    columns = ("loop", "p50 [ms]", "p99 [ms]", "p99.9 [ms]", "wanted", "max [ms]")
    return [Table("Acting while learning", TEXT.format(learned=learning.learned), columns, rows)]


def _warm(acting: Imitator, watched: np.ndarray, lessons: Demonstrations) -> None:
    """Compiles what acting and learning run."""
    for percept in watched[:100]:
        acting.step(percept)
    deepcopy(acting).train().learn(replace(lessons, episodes=lessons.episodes[:3]))


def _row(loop: str, times: np.ndarray, wanted: int | None = None) -> tuple[str, ...]:
    p50, p99, p999 = (number(float(part)) for part in np.percentile(times, (50, 99, 99.9)) / 1e3)
    limit = NOTHING if wanted is None else f"≤ {wanted}"
    return loop, p50, p99, p999, limit, number(times.max() / 1e3)


def main() -> None:
    """Measures and prints."""
    run_alone(__doc__, measure)


if __name__ == "__main__":
    main()
