"""Record, learn and evaluate with a camera: `python -m benchmarks.metaworld --camera`.

Demonstrations and results are kept in a folder. A run does what is missing there, so that it goes
on where it was stopped.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from benchmarks.metaworld.camera import report
from benchmarks.metaworld.camera.evaluation import ABSENT, SIGHTS, evaluate
from benchmarks.metaworld.camera.learners import LEARNERS, OURS
from benchmarks.metaworld.camera.recording import demonstrations_of, load
from benchmarks.metaworld.camera.world import SeenWorld
from benchmarks.metaworld.evaluation import EPISODES
from benchmarks.metaworld.recording import NUMBER
from benchmarks.metaworld.results import Cell, Result, Results
from benchmarks.metaworld.running import check_ranges, run

FOLDER = Path("runs/metaworld/camera")
TASKS = ("button-press-topdown", "drawer-open", "sweep-into", "pick-place")
OTHERS_DRAWS, OTHERS_EPISODES = 1, 20  # of the learners that are none of `OURS`
UNDISTURBED = "usual"
EPILOG = f"""Draws 0 to 2 are for reports alone: choose on --first-draw 3. Learners but
{" and ".join(OURS)} run {OTHERS_DRAWS} draw of {OTHERS_EPISODES} episodes. Ctrl-C loses at most the
cell that is being measured; the same command goes on from there."""


class Arguments(NamedTuple):
    """What to measure."""

    tasks: list[str]
    first_draw: int
    draws: int
    demonstrations: list[int]
    episodes: int
    learners: list[str]
    sights: list[str]
    folder: Path
    again: bool
    """Whether what was measured before is measured anew."""
    write: bool
    """Whether tables go into docs/."""


def parse_arguments(arguments: Sequence[str] | None = None) -> Arguments:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.metaworld --camera",
        description="Learn tasks of Metaworld from pictures and four numbers of state.",
        epilog=EPILOG,
    )
    add = parser.add_argument
    add("--camera", action="store_true", help="this part of the benchmark")
    add(
        "--tasks", nargs="+", metavar="NAME", default=list(TASKS),
        help=f"what is done ({' '.join(TASKS)})",
    )  # fmt: skip
    add("--first-draw", type=int, default=0, metavar="D", help="number of the first draw (0)")
    add("--draws", type=int, default=3, help="draws: choices of demonstrations for a task (3)")
    add(
        "--demonstrations", type=int, nargs="+", metavar="N", default=[5, 20],
        help=f"how many are learned, {NUMBER} at most (5 20)",
    )  # fmt: skip
    add(
        "--episodes", type=int, default=50,
        help="run after each learning, the same for all learners (50)",
    )  # fmt: skip
    add(
        "--learners", nargs="+", choices=LEARNERS, default=list(LEARNERS), metavar="NAME",
        help=f"out of {', '.join(LEARNERS)}; act is LeRobot's ACT (all)",
    )  # fmt: skip
    sights = [name or UNDISTURBED for name in SIGHTS]
    add(
        "--sights", nargs="+", choices=sights, default=sights, metavar="NAME",
        help=f"how pictures differ from those shown, for {OURS[0]} alone: {', '.join(sights)} "
        f"(all); {ABSENT}: the object is not there",
    )  # fmt: skip
    add("--folder", type=Path, default=FOLDER, help=f"for all that is kept ({FOLDER})")
    add("--again", action="store_true", help="measure anew what was measured before")
    add("--write", action="store_true", help="also write all results of the folder into docs/")
    parsed = vars(parser.parse_args(arguments))
    del parsed["camera"]
    parsed["sights"] = [name.replace(UNDISTURBED, "") for name in parsed["sights"]]
    checked = Arguments(**parsed)
    _check(checked, parser)
    return checked


def _check(arguments: Arguments, parser: argparse.ArgumentParser) -> None:
    """End the program if an argument is out of range."""
    ranges = {
        "--first-draw": ([arguments.first_draw], 0, 40),
        "--draws": ([arguments.draws], 1, 50),
        "--demonstrations": (arguments.demonstrations, 1, NUMBER),
        "--episodes": ([arguments.episodes], 1, EPISODES),
    }
    check_ranges(ranges, parser)


def cells(arguments: Arguments) -> Iterator[tuple[Cell, int]]:
    """Yield all cells with their numbers of episodes, those of one world after another."""
    for sight in arguments.sights:
        for task in arguments.tasks:
            for draw in range(arguments.first_draw, arguments.first_draw + arguments.draws):
                for number in arguments.demonstrations:
                    for learner in arguments.learners:
                        if wanted(arguments, draw, learner, sight):
                            cell = Cell(task, draw, number, learner, sight=sight)
                            yield cell, _episodes(arguments, learner)


def wanted(arguments: Arguments, draw: int, learner: str, sight: str) -> bool:
    """Return whether a learner is measured in a draw and a sight."""
    if sight:
        return learner == OURS[0]
    return learner in OURS or draw < arguments.first_draw + OTHERS_DRAWS


def _episodes(arguments: Arguments, learner: str) -> int:
    return arguments.episodes if learner in OURS else min(OTHERS_EPISODES, arguments.episodes)


def measure(arguments: Arguments, results: Results) -> None:
    """Measure what is missing, with a progress bar."""
    missing = [
        (cell, episodes)
        for cell, episodes in cells(arguments)
        if arguments.again or not results.has(cell, episodes)
    ]
    made: dict[tuple[str, bool], SeenWorld] = {}
    with tqdm(missing, "Metaworld, seen", unit="cell", disable=None) as bar:
        for cell, episodes in bar:
            told = f"{cell.demonstrations} by {cell.learner} {cell.sight}".strip()
            bar.set_postfix_str(f"{cell.task} {cell.draw}, {told}")
            root = demonstrations_of(
                _world(made, cell.task), cell.draw, arguments.folder / "demonstrations"
            )
            world = _world(made, cell.task, absent=cell.sight == ABSENT)
            shown = load(root, cell.demonstrations)
            results.keep(cell, evaluate(cell, world, shown, episodes))
    for world in made.values():
        world.close()


def _world(made: dict[tuple[str, bool], SeenWorld], task: str, absent: bool = False) -> SeenWorld:
    """Return a task's world; those of other tasks are closed."""
    for key in [key for key in made if key[0] != task]:
        made.pop(key).close()
    if (task, absent) not in made:
        made[task, absent] = SeenWorld(task, absent=absent)
    return made[task, absent]


def asked_for(arguments: Arguments, found: Mapping[Cell, Result]) -> dict[Cell, Result]:
    """Return the results that belong to these arguments; a folder may hold more."""
    asked = {cell for cell, _ in cells(arguments)}
    return {cell: result for cell, result in found.items() if cell in asked}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print and write."""
    parsed = parse_arguments(arguments)
    results = Results(parsed.folder / "results")
    interrupted = run(lambda: measure(parsed, results))
    found = asked_for(parsed, results.all())
    print(report.markdown(found))
    if parsed.write and not interrupted:
        report.write(found)
    return int(interrupted)
