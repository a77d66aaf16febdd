"""Run tasks on all usable cores; the results do not depend on the number of cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, Protocol

from tqdm import tqdm

from pacnet.kernels.threads import use_one_thread
from train.common.runs import usable_cores

_WORTH_A_POOL = 30  # short tasks; fewer finish before the processes of a pool have started


class Worker(Protocol):
    """Run one task after the other; each process has its own worker."""

    def run(self, task: Any) -> Any:
        """Return the result of one task, which depends on the task alone."""
        ...


def share_out(
    make_worker: Callable[..., Worker],
    arguments: tuple[Any, ...],
    tasks: Sequence[Any],
    label: str,
    unit: str = "episode",
    worth_a_pool: int = _WORTH_A_POOL,
) -> list[Any]:
    """Return the results of all tasks, in their order, with a progress bar.

    Args:
        make_worker: Called in each process; must be importable by name from its module.
        arguments: Of `make_worker`.
        tasks: What the workers run.
        label: Of the progress bar.
        unit: Of the progress bar: what a task is.
        worth_a_pool: Fewest tasks that take longer than processes take to start.
    """
    results = []
    with tqdm(total=len(tasks), desc=label, unit=unit) as progress:
        for result in _results(make_worker, arguments, tasks, worth_a_pool):
            results.append(result)
            progress.update()
    return results


def _results(
    make_worker: Callable[..., Worker],
    arguments: tuple[Any, ...],
    tasks: Sequence[Any],
    worth_a_pool: int,
) -> Iterator[Any]:
    if usable_cores() == 1 or len(tasks) < worth_a_pool:
        yield from map(make_worker(*arguments).run, tasks)
        return
    with processes(_keep_worker, (make_worker, arguments)) as pool:
        yield from pool.map(_run, tasks)


@contextmanager
def processes(
    begin: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool on all usable cores; its processes end with the block or with this process.

    Args:
        begin: Called in each process when it starts.
        arguments: Of `begin`.
    """
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(usable_cores(), spawn, _start, (begin, arguments))
    try:
        yield pool
    except BaseException:
        # The executor's thread may raise on cancelled futures; hide that.
        threading.excepthook = lambda _: None
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _start(begin: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    sys.stderr = open(os.devnull, "w")  # noqa: PTH123, SIM115  # hides their progress bars
    use_one_thread()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin(*arguments)


def _end_with_parent() -> None:
    """End this process when its parent was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


_worker: Worker | None = None  # of this process


def _keep_worker(make_worker: Callable[..., Worker], arguments: tuple[Any, ...]) -> None:
    global _worker
    _worker = make_worker(*arguments)


def _run(task: Any) -> Any:
    assert _worker is not None
    return _worker.run(task)
