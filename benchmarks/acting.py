"""A control loop that runs while another thread learns: `python -m benchmarks.acting`."""

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
LESSONS, SHORT = 200, 50  # demonstrations to learn meanwhile, and frames of each
_Times = TypeVar("_Times")
WANTED = 5  # 99.9th percentile [ms]

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
    """Lets an imitator learn demonstrations in another thread, one after the other.

    Attributes:
        learned: Number of demonstrations learned so far.
        over: Set when all are learned, or learning failed.
    """

    def __init__(self, imitator: Imitator, episodes: Demonstrations) -> None:
        self.learned, self.over = 0, threading.Event()
        self._imitator, self._episodes = imitator.train(), episodes

    @contextmanager
    def in_background(self) -> Iterator[None]:
        """Learn while the block runs; raise the thread's errors at its end."""
        with ThreadPoolExecutor(1) as pool:
            learning = pool.submit(self._learn)
            yield
            learning.result()

    def _learn(self) -> None:
        try:
            for shown in self._episodes:
                self._imitator.learn(replace(self._episodes, episodes=(shown,)))
                self.learned += 1
        finally:
            self.over.set()


class Steady(NamedTuple):
    """Times of the steps of a steady loop, each `[T]` [µs]."""

    taken: np.ndarray
    """Duration of the call."""
    since_due: np.ndarray
    """From the time when the step was due to its end."""


def steady(acting: Imitator, percepts: Iterator[np.ndarray], rate: float) -> Steady:
    """Step `rate` times a second; a late step is not made up for."""
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
    """Measure one row for each kind of loop, alone and while learning."""
    taught, watched = imitator("auto")
    episodes, _ = laps(LESSONS, SHORT)
    _warm(taught, watched, episodes)
    alone = steady(taught, islice(cycle(watched), steps[0]), rate)
    busy_alone = latencies(taught.step, islice(cycle(watched), steps[1]))

    def while_learning(loop: Callable[[Imitator, Iterator[np.ndarray]], _Times]) -> _Times:
        acting = deepcopy(taught)
        learning = Learning(acting, episodes)
        with learning.in_background():
            return loop(acting, takewhile(lambda _: not learning.over.is_set(), cycle(watched)))

    steady_beside = while_learning(lambda acting, percepts: steady(acting, percepts, rate))
    busy_beside = while_learning(
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


def _warm(acting: Imitator, watched: np.ndarray, episodes: Demonstrations) -> None:
    """Compile what acting and learning run."""
    for percept in watched[:100]:
        acting.step(percept)
    deepcopy(acting).train().learn(replace(episodes, episodes=episodes.episodes[:3]))


def _row(loop: str, times: np.ndarray, wanted: int | None = None) -> tuple[str, ...]:
    p50, p99, p999 = (number(float(part)) for part in np.percentile(times, (50, 99, 99.9)) / 1e3)
    limit = NOTHING if wanted is None else f"≤ {wanted}"
    return loop, p50, p99, p999, limit, number(times.max() / 1e3)


if __name__ == "__main__":
    run_alone(__doc__, measure)
