"""Many maps in one call against one call a map: `python -m benchmarks.ensemble`."""

from __future__ import annotations

import os
from collections.abc import Callable

import torch

from benchmarks.harness import NOTHING, Table, factor, number, race, run_alone
from benchmarks.streams import CASES
from pacnet import HabituatingSOFM, SOFMEnsemble

MAPS, THREADS = 64, 2
CASE = CASES["small"]

TEXT = f"""{MAPS} maps with preset `gwr`, each with its own stream ({CASE.title}), learned from
empty. The one call uses {THREADS} threads (`torch.set_num_threads`), of {{cores}} cores.
"""


def measure() -> list[Table]:
    """Both ways, in turn."""
    torch.set_num_threads(THREADS)
    streams = [torch.from_numpy(CASE.stream(seed)) for seed in range(MAPS)]

    def fresh() -> list[HabituatingSOFM]:
        return [HabituatingSOFM(CASE.config("gwr"), engine="compiled") for _ in streams]

    def calls() -> Callable[[], object]:
        maps = fresh()
        return lambda: [som.observe(stream) for som, stream in zip(maps, streams, strict=True)]

    def one_call() -> Callable[[], object]:
        ensemble = SOFMEnsemble(fresh())
        return lambda: ensemble.observe(streams)

    contestants = {f"{MAPS} calls": calls, "one call": one_call}
    for prepare in contestants.values():
        prepare()()
    times = race(contestants, budget=8)
    apart, together = times.values()
    rows = [
        (f"{MAPS} calls of `HabituatingSOFM.observe`", number(apart * 1e3), NOTHING, NOTHING),
        ("`SOFMEnsemble.observe`", number(together * 1e3), factor(apart / together), "≥ 1.7 ×"),
    ]
    columns = ("what", "ms", "faster", "wanted")
    text = TEXT.format(cores=os.cpu_count())
    return [Table(f"{MAPS} independent maps", text, columns, rows)]


def main() -> None:
    """Measures and prints."""
    run_alone(__doc__, measure)


if __name__ == "__main__":
    main()
