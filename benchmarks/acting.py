"""A control loop that goes on while another thread learns: `python -m benchmarks.acting`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from itertools import cycle, islice, takewhile
from typing import NamedTuple, TypeVar

import numpy as np

from benchmarks.harness import NOTHING, Table, latencies, number, run_alone
from benchmarks.step import DIMENSIONS, JOINTS, LENGTH, SHOWN, imitator, laps
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.imitator import Imitator

RATE = 500  # of the steady control loop [1/s]
STEADY, BUSY = 5_000, 20_000  # steps of each kind of loop, alone
LESSONS, SHORT = 200, 50  # demonstrations that are learned meanwhile, and frames of each
_Times = TypeVar("_Times")
WANTED = 5  # [ms], of all but one step in a thousand

TEXT = f"""`Imitator.step` of an imitator that has learned {SHOWN} demonstrations of {LENGTH}
frames, {DIMENSIONS} dimensions and {JOINTS} actions. Meanwhile another thread of the same process
lets the same imitator learn {LESSONS} demonstrations of {SHORT} frames, one call of
`Imitator.learn` each. The steady loop steps {RATE} times a second and sleeps in between, until the
last demonstration is learned; the busy loop takes {BUSY:,} steps without a pause. Alone they take
{STEADY:,} and {BUSY:,} steps. The time of a step is that of the call; "from when it was due" adds
the delay with which the loop woke up. All kernels were compiled before. Both threads share one
interpreter, so each waits until the other releases it.
"""


class Learning:
    """A thread that lets an imitator learn demonstrations, one after the other.

    Attributes:
        learned: number of demonstrations learned so far.
        over: set when it has learned them all, or failed.
    """

    def __init__(self, imitator: Imitator, lessons: Demonstrations) -> None:
        self.learned, self.over = 0, threading.Event()
        self._imitator, self._lessons = imitator.train(), lessons

    @contextmanager
    def beside(self) -> Iterator[None]:
        """Learns beside the block; an error of the thread is raised at its end."""
        with ThreadPoolExecutor(1) as pool:
            learning = pool.submit(self._learn)
            yield
            learning.result()

    def _learn(self) -> None:
        try:
            for shown in self._lessons:
                self._imitator.learn(replace(self._lessons, episodes=(shown,)))
                self.learned += 1
        finally:
            self.over.set()


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
    taught, watched = imitator("auto")
    lessons, _ = laps(LESSONS, SHORT)
    _warm(taught, watched, lessons)
    alone = steady(taught, islice(cycle(watched), steps[0]), rate)
    busy_alone = latencies(taught.step, islice(cycle(watched), steps[1]))

    def beside(loop: Callable[[Imitator, Iterator[np.ndarray]], _Times]) -> _Times:
        acting = deepcopy(taught)
        learning = Learning(acting, lessons)
        with learning.beside():
            return loop(acting, takewhile(lambda _: not learning.over.is_set(), cycle(watched)))

    steady_beside = beside(lambda acting, percepts: steady(acting, percepts, rate))
    busy_beside = beside(
        lambda acting, percepts: latencies(acting.step, islice(percepts, steps[1]))
    )
    rows = [
        _row("steady, alone", alone.taken),
        _row("steady, beside learning", steady_beside.taken, WANTED),
        _row("steady, alone, from when it was due", alone.since_due),
        _row("steady, beside learning, from when it was due", steady_beside.since_due),
        _row("busy, alone", busy_alone),
        _row("busy, beside learning", busy_beside, WANTED),
    ]
    columns = ("loop", "p50 [ms]", "p99 [ms]", "p99.9 [ms]", "wanted", "max [ms]")
    return [Table("Acting while learning", TEXT, columns, rows)]


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
