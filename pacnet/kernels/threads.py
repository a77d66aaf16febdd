"""Work shared among threads, for kernels that release Python's global lock."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

_WORTH_A_THREAD = 2**20  # multiplications, some 0.1 ms
_Part = TypeVar("_Part")
_Result = TypeVar("_Result")


def use_one_thread() -> None:
    """Let torch use one thread, because with small tensors more threads wait for one another."""
    torch.set_num_threads(1)


def in_threads(call: Callable[[_Part], _Result], parts: Iterable[_Part]) -> list[_Result]:
    """Call it for each part, in as many threads as torch uses; return results in order."""
    threads = torch.get_num_threads()
    parts = list(parts)
    if threads == 1 or len(parts) == 1:
        return [call(part) for part in parts]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(call, parts))


def share_rows(call: Callable[[int, int], None], rows: int, work: int) -> None:
    """Split rows into ranges and call with the first row of each and the one after its last.

    The ranges run in threads if they are worth it: `work` is the multiplications for all rows.
    """
    shares = max(1, min(4 * torch.get_num_threads(), rows, work // _WORTH_A_THREAD))
    ends = [rows * share // shares for share in range(shares + 1)]
    in_threads(lambda ends: call(*ends), itertools.pairwise(ends))
