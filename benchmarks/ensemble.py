"""Many maps in one call, compared with one call for each: `python -m benchmarks.ensemble`."""

from __future__ import annotations

import os
from collections.abc import Callable

import torch

from benchmarks.harness import NOTHING, Table, factor, median_times, number, run_alone
from benchmarks.streams import CASES, Case
from pacnet import HabituatingSOFM, SOFMEnsemble

MAPS, THREADS = 64, 2

TEXT = f"""{MAPS} maps with preset `gwr`, each with its own stream, learned from empty. The single
call uses {THREADS} threads (`torch.set_num_threads`) on {{cores}} cores. For short streams, most of
the time goes to Python code for each map, which threads cannot run in parallel.
"""


def measure() -> list[Table]:
    """Measure both ways, interleaved, for short and long streams."""
    torch.set_num_threads(THREADS)
    rows = [row for case in (CASES["small"], CASES["long"]) for row in _compare(case)]
    columns = ("what", "ms", "faster", "wanted")
    text = TEXT.format(cores=os.cpu_count())
    return [Table(f"{MAPS} independent maps", text, columns, rows)]


def _compare(case: Case) -> list[tuple[str, ...]]:
    streams = [torch.from_numpy(case.stream(seed)) for seed in range(MAPS)]

    def new_maps() -> list[HabituatingSOFM]:
        return [HabituatingSOFM(case.config("gwr"), engine="compiled") for _ in streams]

    def calls() -> Callable[[], object]:
        maps = new_maps()
        return lambda: [som.observe(stream) for som, stream in zip(maps, streams, strict=True)]

    def one_call() -> Callable[[], object]:
        ensemble = SOFMEnsemble(new_maps())
        return lambda: ensemble.observe(streams)

    candidates = {f"{MAPS} calls": calls, "one call": one_call}
    for prepare in candidates.values():
        prepare()()
    times = median_times(candidates, budget=8)
    apart, together = times.values()
    return [
        (f"{case.title}: {MAPS} calls of `HabituatingSOFM.observe`", number(apart * 1e3), *_EMPTY),
        (
            f"{case.title}: `SOFMEnsemble.observe`",
            number(together * 1e3),
            factor(apart / together),
            "≥ 1.7 ×",
        ),
    ]


_EMPTY = NOTHING, NOTHING


if __name__ == "__main__":
    run_alone(__doc__, measure)
