"""Record, learn and evaluate: `python -m benchmarks.metaworld`.

Demonstrations and results are kept in a folder. A run does what is missing there, so that it goes
on where it was stopped.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from benchmarks.metaworld import report, tasks
from benchmarks.metaworld.evaluation import EPISODES, evaluate
from benchmarks.metaworld.features import View
from benchmarks.metaworld.learners import LEARNERS
from benchmarks.metaworld.recording import NUMBER, ExpertFailsError, demonstrations_of, load
from benchmarks.metaworld.results import Cell, Result, Results
from benchmarks.metaworld.running import check_ranges, run
from benchmarks.metaworld.simulation import World

FOLDER = Path("runs/metaworld")
CAMERA = "--camera"
EPILOG = """Tasks of the set `held-out` are for reports alone: tune on `development`. Ctrl-C loses
at most the cell that is being measured; the same command goes on from there. Several commands may
run at a time in one folder, on different tasks."""


class Arguments(NamedTuple):
    """What to measure."""

    tasks: list[str]
    draws: int
    demonstrations: list[int]
    episodes: int
    learners: list[str]
    folder: Path
    view: View
    again: bool
    """Whether what was measured before is measured anew."""
    write: bool
    """Whether tables and figure go into docs/."""


def parse_arguments(arguments: Sequence[str] | None = None) -> Arguments:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.metaworld",
        description="Learn tasks of Metaworld from few demonstrations, beside baselines.",
        epilog=EPILOG,
    )
    add = parser.add_argument
    add(
        "--tasks", nargs="+", metavar="NAME", default=["development", "held-out"],
        help="development, held-out, other (all further tasks), or names (development held-out)",
    )  # fmt: skip
    add("--draws", type=int, default=3, help="choices of demonstrations for each task (3)")
    add(
        "--demonstrations", type=int, nargs="+", metavar="N", default=[1, 5, 20],
        help=f"how many are learned, {NUMBER} at most (1 5 20)",
    )  # fmt: skip
    add("--episodes", type=int, default=50, help="of each cell, the same for all learners (50)")
    add(
        "--learners", nargs="+", choices=LEARNERS, default=list(LEARNERS), metavar="NAME",
        help=f"out of {', '.join(LEARNERS)} (all)",
    )  # fmt: skip
    add("--folder", type=Path, default=FOLDER, help=f"for all that is kept ({FOLDER})")
    add("--noise", type=float, default=0.0, help="of perceived places, at each step [m] (0)")
    add("--units", type=float, default=1.0, help="of percepts per metre; 1000: millimetres (1)")
    add("--turn", type=float, default=0.0, help="of the percepts' axes about z [degrees] (0)")
    add(CAMERA, action="store_true", help=f"see by a camera: see {CAMERA} --help")
    add("--again", action="store_true", help="measure anew what was measured before")
    add("--write", action="store_true", help="also write all results of the folder into docs/")
    parsed = vars(parser.parse_args(arguments))
    del parsed["camera"]  # handled before
    view = View(*(parsed.pop(name) for name in ("noise", "units", "turn")))
    checked = Arguments(**parsed, view=view)
    _check(checked, parser)
    return checked


def _check(arguments: Arguments, parser: argparse.ArgumentParser) -> None:
    """End the program if an argument is out of range."""
    ranges = {
        "--draws": ([arguments.draws], 1, 50),
        "--demonstrations": (arguments.demonstrations, 1, NUMBER),
        "--episodes": ([arguments.episodes], 1, EPISODES),
    }
    check_ranges(ranges, parser)
    if arguments.view.noise < 0 or not arguments.view.units > 0:
        parser.error(f"expected --noise ≥ 0 and --units > 0, got {arguments.view}")


def cells(arguments: Arguments, names: Sequence[str]) -> Iterator[Cell]:
    """Yield all cells, those of one dataset after another."""
    for draw in range(arguments.draws):
        for task in names:
            for number in arguments.demonstrations:
                for learner in arguments.learners:
                    yield Cell(task, draw, number, learner, arguments.view)


def measure(arguments: Arguments, results: Results) -> None:
    """Measure what is missing, with a progress bar."""
    world, out = None, set(results.failed_experts)
    names = [task for task in tasks.choose(arguments.tasks) if task not in out]
    missing = [
        cell
        for cell in cells(arguments, names)
        if arguments.again or not results.has(cell, arguments.episodes)
    ]
    datasets = arguments.folder / "demonstrations"
    with tqdm(missing, "Metaworld", unit="cell", disable=None) as bar:
        for cell in bar:
            if cell.task in out:
                continue
            bar.set_postfix_str(f"{cell.task} {cell.draw}, {cell.demonstrations} by {cell.learner}")
            if world is None or world.task != cell.task:
                world = World(cell.task)
            try:
                shown = load(demonstrations_of(world, cell.draw, datasets), cell.demonstrations)
            except ExpertFailsError as error:
                out.add(cell.task)
                results.leave_out(cell.task, str(error))
            else:
                results.keep(cell, evaluate(cell, world, shown, arguments.episodes))


def asked_for(arguments: Arguments, found: Mapping[Cell, Result]) -> dict[Cell, Result]:
    """Return the results that belong to these arguments; a folder may hold more."""
    asked = set(cells(arguments, tasks.choose(arguments.tasks)))
    return {cell: result for cell, result in found.items() if cell in asked}


def main() -> int:
    """Measure, print and write."""
    if CAMERA in sys.argv[1:]:
        from benchmarks.metaworld.camera import command  # which has options of its own

        return command.main()
    arguments = parse_arguments()
    results = Results(arguments.folder / "results")
    interrupted = run(lambda: measure(arguments, results))
    found, failed = results.all(), results.failed_experts
    print(report.markdown(asked_for(arguments, found), failed))
    if arguments.write and not interrupted:
        report.write(found, failed)
    return int(interrupted)


if __name__ == "__main__":
    sys.exit(main())
