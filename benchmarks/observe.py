"""Learning a stream in one online pass, compared with a C loop and other packages.

Run it alone with `python -m benchmarks.observe`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import torch

from benchmarks import floor
from benchmarks.grow_when_required import GrowWhenRequired
from benchmarks.harness import NOTHING, Candidate, Table, factor, median_times, number, run_alone
from benchmarks.peers import PEERS, Run
from benchmarks.streams import CASES, Case
from pacnet import HabituatingSOFM

PRESETS = ("paper", "gwr")
WANTED_OF_FLOOR = 2.0  # largest time relative to the C loop
WANTED_BEFORE_GROWING = 30  # smallest factor to every growing peer
WANTED_BEFORE = {"MiniSom": 20}
SAMPLES = {"eager": 5_000, "MiniSom": 20_000}  # for the slow ones, whose cost hardly changes later
FLOOR, COMPILED = "C loop", "pacnet, compiled"
GROWING = ("numpy", *(name for name, peer in PEERS.items() if peer.grows))

TEXT = """One pass from an empty map over {samples:,} percepts of {dimensions} dimensions: noisy
laps on {behaviours} smooth path{s} through {via} via points. Thresholds {paper} (`paper`) and {gwr}
(`gwr`). One thread. The column "pacnet is faster by" refers to the slower preset of the compiled
engine.
"""


class Entry(NamedTuple):
    """One row: which candidate learns which part of the stream, under which preset."""

    name: str
    preset: str | None
    what: str
    samples: int
    prepare: Callable[[], Run] | None
    """None if it is not installed."""


def entries(case: Case, percepts: np.ndarray) -> list[Entry]:
    """Return all candidates for one stream."""
    own = [
        ("eager", "pacnet, eager torch", partial(_prepare_observe, "eager")),
        ("compiled", COMPILED, partial(_prepare_observe, "compiled")),
        ("step", "pacnet, compiled, `step` a sample", _prepare_steps),
    ]
    found = [
        Entry("floor", preset, FLOOR, len(percepts), _floor(case, preset, percepts))
        for preset in PRESETS
    ]
    for name, what, prepare in own:
        samples = SAMPLES.get(name, len(percepts))
        for preset in PRESETS:
            start = partial(prepare, case, preset, percepts[:samples])
            found.append(Entry(name, preset, what, min(samples, len(percepts)), start))
    numpy = partial(_prepare_numpy, case, percepts)
    found.append(Entry("numpy", None, "plain numpy GWR", len(percepts), numpy))
    return found + [_peer(name, case, percepts) for name in PEERS]


def _peer(name: str, case: Case, percepts: np.ndarray) -> Entry:
    peer, part = PEERS[name], percepts[: SAMPLES.get(name)]
    prepare = partial(peer.prepare, part, case.nodes) if peer.installed else None
    return Entry(name, None, f"{name}: {peer.does}", len(part), prepare)


def _floor(case: Case, preset: str, percepts: np.ndarray) -> Callable[[], Run] | None:
    built = floor.build()
    if built is None:
        return None
    config, nodes = case.config(preset), []

    def prepare() -> Run:
        return Run(lambda: nodes.append(built.observe(config, percepts)[0]), lambda: nodes[-1])

    return prepare


def _prepare_observe(engine: str, case: Case, preset: str, percepts: np.ndarray) -> Run:
    som = HabituatingSOFM(case.config(preset), engine=engine)
    tensor = torch.from_numpy(percepts)
    return Run(lambda: som.observe(tensor), lambda: len(som))


def _prepare_steps(case: Case, preset: str, percepts: np.ndarray) -> Run:
    som = HabituatingSOFM(case.config(preset), engine="compiled")

    def learn() -> None:
        for percept in percepts:
            som.step(percept)

    return Run(learn, lambda: len(som))


def _prepare_numpy(case: Case, percepts: np.ndarray) -> Run:
    network = GrowWhenRequired(case.config("gwr"))
    return Run(lambda: network.learn(percepts), lambda: network.count)


def measure_case(name: str, case: Case, budget: float = 2.0) -> Table:
    """Measure the table of one stream."""
    percepts = case.stream()
    found = entries(case, percepts)
    _compile(case, percepts[:50])
    sizes: dict[str, int] = {}

    def candidate(entry: Entry, key: str) -> Candidate:
        def prepare() -> Callable[[], None]:
            run = entry.prepare()

            def learn() -> None:
                run.learn()
                sizes[key] = run.size()

            return learn

        return prepare

    prepared = {_key(e): candidate(e, _key(e)) for e in found if e.prepare is not None}
    times = median_times(prepared, budget)
    cost = {_key(e): times[_key(e)] / e.samples * 1e6 for e in found if e.prepare is not None}
    rows = [_row(name, entry, cost, sizes) for entry in found]
    text = TEXT.format(
        **case._asdict() | {"paper": case.paper_threshold, "gwr": case.gwr_threshold},
        s="s" * (case.behaviours > 1),
        via=8,
    )
    columns = ("who", "nodes", "µs a sample", "of the C loop", "pacnet is faster by", "wanted")
    return Table(f"`observe`: {case.title}", text, columns, rows)


def _compile(case: Case, percepts: np.ndarray) -> None:
    """Compile everything before the measurement."""
    for entry in entries(case, percepts):
        if entry.prepare is not None:
            entry.prepare().learn()


def _key(entry: Entry) -> str:
    return f"{entry.name} {entry.preset}"


def _row(case: str, entry: Entry, cost: dict[str, float], sizes: dict[str, int]) -> tuple[str, ...]:
    who = entry.what if entry.preset is None else f"{entry.what}, `{entry.preset}`"
    if entry.samples < CASES[case].samples:
        who += f" (first {entry.samples:,})"
    if entry.prepare is None:
        missing = "no C compiler" if entry.name == "floor" else "not installed"
        return (who, missing, *[NOTHING] * 4)
    own = cost[_key(entry)]
    least = cost.get(f"floor {entry.preset or 'gwr'}")
    of_floor = factor(own / least) if least else NOTHING
    ahead, wanted = NOTHING, NOTHING
    if entry.preset is None:
        ahead = factor(own / max(cost[f"compiled {preset}"] for preset in PRESETS))
        least_ahead = WANTED_BEFORE.get(entry.name)
        if entry.name in GROWING:
            least_ahead = WANTED_BEFORE_GROWING
        wanted = f"≥ {least_ahead} ×" if least_ahead else NOTHING
    elif entry.name == "compiled":
        wanted = f"≤ {WANTED_OF_FLOOR} ×"
    return (who, f"{sizes[_key(entry)]:,}", number(own), of_floor, ahead, wanted)


def measure() -> list[Table]:
    """Measure one table for each stream."""
    return [measure_case(name, case) for name, case in CASES.items()]


if __name__ == "__main__":
    run_alone(__doc__, measure)
