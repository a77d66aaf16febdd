"""The tables and the figure of the Metaworld benchmark, in docs/benchmarks.md."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from statistics import fmean, median

from benchmarks import results_page
from benchmarks.harness import NOTHING, Table, number
from benchmarks.metaworld import tasks
from benchmarks.metaworld.evaluation import SEEDS
from benchmarks.metaworld.features import View
from benchmarks.metaworld.learners import LEARNERS, TITLES
from benchmarks.metaworld.recording import LEAST_SUCCESS, NOISE
from benchmarks.metaworld.results import Cell, Result
from benchmarks.metaworld.simulation import FPS, HORIZON

Found = Mapping[Cell, Result]
Place = tuple[str, int]  # a task and a draw

FILM = Path(__file__).parents[2] / "docs" / "images" / "metaworld.gif"  # see `film`
FILM_LINK = f"![Shown once on the left, imitated in other places on the right](images/{FILM.name})"
SETS = (*tasks.SETS, tasks.OTHER)
ALL = "all"
TEXT = f"""`make metaworld` runs it: a robot's hand and gripper do a task of Metaworld at {FPS} Hz,
from percepts of places alone: hand, gripper, objects, goal. Metaworld's scripted experts
demonstrate, with noise of {NOISE:g} on each action; then things lie elsewhere. Success: share of
the episodes in which Metaworld says so within {HORIZON} steps, mean over {{draws}} of
demonstrations, {{episodes}} episodes each, then over the tasks. All learners meet the same places
(seeds from {SEEDS:,}). Where the imitator holds, the zero action is sent. All baselines but replay
are given places relative to one another. Methods may be tuned on the tasks `development` alone. A
learner has no number where it was not measured on all tasks and choices of the row.{{out}}
"""
TIMES_TEXT = """Median over all cells: of the time to learn all demonstrations, and of the median
time of a step. One thread.
"""
TASKS_TEXT = "Success on each task, with percepts as they are."


def markdown(found: Found, failed: Mapping[str, str]) -> str:
    """Return all tables.

    Args:
        found: what was measured.
        failed: tasks that were left out, with what their experts achieved.
    """
    return "\n\n".join(
        map(str, (sets_table(found, failed), tasks_table(found), times_table(found)))
    )


def write(found: Found, failed: Mapping[str, str]) -> None:
    """Write tables and figure into docs/."""
    from benchmarks.metaworld import figure  # which imports matplotlib

    figure.draw(found)
    parts = [markdown(found, failed), figure.LINK, *([FILM_LINK] if FILM.exists() else [])]
    results_page.update("metaworld", "\n\n".join(parts))


def learners_of(found: Iterable[Cell]) -> list[str]:
    """Return the learners that were measured, in the order of tables."""
    measured = {cell.learner for cell in found}
    return [name for name in LEARNERS if name in measured]


def success(found: Found, learner: str) -> float | None:
    """Return a learner's mean success over draws, then tasks; None unless it has all of them."""
    everywhere = {(cell.task, cell.draw) for cell in found}
    own = {(c.task, c.draw): r.success for c, r in found.items() if c.learner == learner}
    if not everywhere or own.keys() != everywhere:
        return None
    by_task = {task: [s for (t, _), s in own.items() if t == task] for task, _ in own}
    return fmean(map(fmean, by_task.values()))


def sets_table(found: Found, failed: Mapping[str, str]) -> Table:
    """Return a row for each set of tasks, view and number of demonstrations."""
    learners = learners_of(found)
    rows = []
    for name in (*SETS, ALL):
        of_set = {c: r for c, r in found.items() if name in (ALL, tasks.set_of(c.task))}
        for view, count in _sorted_kinds(of_set):
            part = {c: r for c, r in of_set.items() if (c.view, c.demonstrations) == (view, count)}
            label = ", ".join(filter(None, (name, str(view), str(count))))
            rows.append((label, str(len({c.task for c in part})), *_shares(part, learners)))
    columns = ("tasks, demonstrations", "number", *(TITLES[name] for name in learners))
    draws = len({cell.draw for cell in found})
    episodes = sorted({len(result.successes) for result in found.values()})
    text = TEXT.format(
        draws=f"{draws} choice{'s' if draws != 1 else ''}",
        episodes=" or ".join(map(str, episodes)),
        out=_left_out(failed),
    )
    return Table("Metaworld: manipulation from few demonstrations", text, columns, rows)


def tasks_table(found: Found) -> Table:
    """Return a row for each task and number of demonstrations, seen as usual."""
    usual = {c: r for c, r in found.items() if c.view == View()}
    learners = learners_of(usual)
    places = [(name, task) for name in SETS for task in _tasks_of(usual, name)]
    rows = []
    for name, task in places:
        for count in sorted({c.demonstrations for c in usual if c.task == task}):
            part = {c: r for c, r in usual.items() if c.task == task and c.demonstrations == count}
            rows.append((f"{task}, {count}", name, *_shares(part, learners)))
    columns = ("task, demonstrations", "set", *(TITLES[name] for name in learners))
    return Table("Metaworld: each task", TASKS_TEXT, columns, rows)


def times_table(found: Found) -> Table:
    """Return a row for each learner and number of demonstrations."""
    rows = []
    for name in learners_of(found):
        for count in sorted({c.demonstrations for c in found if c.learner == name}):
            part = [r for c, r in found.items() if (c.learner, c.demonstrations) == (name, count)]
            learning = number(median(r.learning_s for r in part))
            step = number(median(r.step_us for r in part))
            held = f"{fmean(r.held for r in part):.0%}"
            rows.append((f"{TITLES[name]}, {count}", learning, step, held))
    columns = ("learner, demonstrations", "learning [s]", "step [µs]", "held")
    return Table("Metaworld: times", TIMES_TEXT, columns, rows)


def _left_out(failed: Mapping[str, str]) -> str:
    """Return a sentence about the tasks that were left out; nothing if there are none."""
    reasons = "; ".join(failed.values())
    return f" Left out, as experts need {LEAST_SUCCESS:.0%}: {reasons}." if failed else ""


def _shares(part: Found, learners: Iterable[str]) -> list[str]:
    """Return each learner's success as a cell."""
    shares = [success(part, name) for name in learners]
    return [NOTHING if share is None else f"{share:.0%}" for share in shares]


def _tasks_of(found: Iterable[Cell], name: str) -> list[str]:
    """Return the measured tasks of a set, in its order."""
    measured = {cell.task for cell in found if tasks.set_of(cell.task) == name}
    order = tasks.SETS.get(name, tuple(sorted(measured)))
    return [task for task in order if task in measured]


def _sorted_kinds(found: Iterable[Cell]) -> list[tuple[View, int]]:
    """Return the views and numbers of demonstrations, the usual view first."""
    kinds = {(cell.view, cell.demonstrations) for cell in found}
    return sorted(kinds, key=lambda kind: (str(kind[0]), kind[1]))
