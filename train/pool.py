"""Shares tasks out among all usable cores; the number of cores changes nothing in the results."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Protocol

import torch
from tqdm import tqdm

from train.runs import usable_cores

_WORTH_A_POOL = 30  # tasks; fewer are over before the processes of a pool have started


class Worker(Protocol):
    """What runs one task after the other; each process has its own."""

    def run(self, task: Any) -> Any:
        """The result of one task, decided by it alone."""
        ...


def share_out(
    make_worker: Callable[..., Worker],
    arguments: tuple[Any, ...],
    tasks: Sequence[Any],
    label: str,
    unit: str = "episode",
) -> list[Any]:
    """The results of all tasks, in their order, under a progress bar.

    Args:
        make_worker: called in each process; found by its name in its module.
        arguments: for it.
        tasks: what the workers run.
        label: of the progress bar.
        unit: a task is one of.
    """
    results = []
    with tqdm(total=len(tasks), desc=label, unit=unit) as progress:
        for result in _results(make_worker, arguments, tasks):
            results.append(result)
            progress.update()
    return results


def _results(
    make_worker: Callable[..., Worker], arguments: tuple[Any, ...], tasks: Sequence[Any]
) -> Iterator[Any]:
    cores = usable_cores()
    if cores == 1 or len(tasks) < _WORTH_A_POOL:
        yield from map(make_worker(*arguments).run, tasks)
        return
    pool = ProcessPoolExecutor(
        cores, multiprocessing.get_context("spawn"), _start, (make_worker, arguments)
    )
    try:
        yield from pool.map(_run, tasks)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


_worker: Worker | None = None  # of this process


def _start(make_worker: Callable[..., Worker], arguments: tuple[Any, ...]) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    torch.set_num_threads(1)
    _worker = make_worker(*arguments)


def _run(task: Any) -> Any:
    assert _worker is not None
    return _worker.run(task)
