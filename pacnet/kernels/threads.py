"""Work shared out over threads, for kernels that let Python go on while they run."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

_WORTH_A_THREAD = 2**20  # multiplications, some 0.1 ms
_Given = TypeVar("_Given")
_Made = TypeVar("_Made")


def use_one_thread() -> None:
    """For small tensors, over which more threads would only wait on one another."""
    torch.set_num_threads(1)


def in_threads(call: Callable[[_Given], _Made], parts: Iterable[_Given]) -> list[_Made]:
    """Calls it for each part, in as many threads as torch uses; results in the parts' order."""
    threads = torch.get_num_threads()
    parts = list(parts)
    if threads == 1 or len(parts) == 1:
        return [call(part) for part in parts]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(call, parts))


def share_rows(call: Callable[[int, int], None], rows: int, work: int) -> None:
    """Calls it for stretches of rows, from a first one until before a last one.

    Args:
        call: with the two ends of a stretch.
        rows: number of rows.
        work: multiplications that all of them take; too few of them stay together.
    """
    shares = max(1, min(4 * torch.get_num_threads(), rows, work // _WORTH_A_THREAD))
    ends = [rows * share // shares for share in range(shares + 1)]
    in_threads(lambda ends: call(*ends), itertools.pairwise(ends))
