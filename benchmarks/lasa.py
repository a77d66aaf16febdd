"""The LASA handwriting benchmark as a closed loop: `python -m benchmarks.lasa`.

A point follows an imitator that was shown one drawing of a shape, or three. Its path is compared
with a drawing that was not shown, as are those of blended replay and of the nearest neighbour.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch

from benchmarks.harness import Table
from benchmarks.lasa_data import DEVELOPMENT, REPORT, SHAPES, MissingDataError
from benchmarks.lasa_pauses import pauses_table
from benchmarks.lasa_policies import IMITATOR, REPLAY
from benchmarks.lasa_scores import AT_EACH_RATE, RATES, rates_table, score_shapes, scores_table

GROUPS = {"all": SHAPES, "development": DEVELOPMENT, "report": REPORT}


class Arguments(NamedTuple):
    """What to measure."""

    shapes: str
    """One of `GROUPS`."""
    hz: int
    """Steps per second, except of the table of rates [1/s]."""
    seed: int
    tables: list[str]
    """Out of `TABLES`."""
    write: bool
    """Whether the tables go into docs/benchmarks.md."""


def parse_arguments(arguments: Sequence[str] | None = None) -> Arguments:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.lasa",
        description="Run the LASA handwriting benchmark as a closed loop; print its tables.",
        epilog="All tables take about five minutes. Ctrl-C ends it and keeps nothing.",
    )
    parser.add_argument(
        "--shapes", choices=GROUPS, default="all", help="those to tune on, the rest, or all"
    )
    parser.add_argument(
        "--hz", type=int, choices=RATES, default=50, help="steps per second; 50 without it"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the choice of drawings")
    parser.add_argument(
        "--tables", nargs="+", choices=TABLES, default=list(TABLES), help="only these"
    )
    parser.add_argument(
        "--write", action="store_true", help="also write the tables into docs/benchmarks.md"
    )
    parsed = Arguments(**vars(parser.parse_args(arguments)))
    if parsed.seed < 0:
        parser.error(f"expected a seed ≥ 0, got {parsed.seed}")
    if parsed.write and (parsed.shapes != "all" or set(parsed.tables) != set(TABLES)):
        parser.error("expected all shapes and all tables with --write, got fewer")
    return parsed


def measure_scores(arguments: Arguments) -> Table:
    """Measure every learner under every condition."""
    shapes, hz, seed = GROUPS[arguments.shapes], arguments.hz, arguments.seed
    groups = GROUPS if arguments.shapes == "all" else {arguments.shapes: shapes}
    return scores_table(score_shapes(shapes, hz, seed), groups, hz, seed)


def measure_rates(arguments: Arguments) -> Table:
    """Measure the imitator at each rate."""
    shapes, seed = GROUPS[arguments.shapes], arguments.seed
    learners = (IMITATOR, REPLAY)
    scores = {hz: score_shapes(shapes, hz, seed, learners, AT_EACH_RATE) for hz in RATES}
    return rates_table(scores, shapes, seed)


def measure_pauses(arguments: Arguments) -> Table:
    """Measure how often learners get past a pause."""
    return pauses_table(GROUPS[arguments.shapes], arguments.hz, arguments.seed)


TABLES: dict[str, Callable[[Arguments], Table]] = {
    "scores": measure_scores,
    "rates": measure_rates,
    "pauses": measure_pauses,
}


def main() -> None:
    """Measure, print and write."""
    arguments = parse_arguments()
    torch.set_num_threads(1)
    tables = []
    try:
        for name in arguments.tables:
            tables.append(str(TABLES[name](arguments)))
            print(f"{tables[-1]}\n", flush=True)
    except MissingDataError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit("interrupted: nothing was written")
    if arguments.write:
        from benchmarks import results_page

        results_page.update("lasa", "\n\n".join(tables))


if __name__ == "__main__":
    main()
