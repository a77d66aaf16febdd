"""The figure of the Metaworld benchmark: success over the number of demonstrations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from benchmarks.metaworld import report, tasks
from benchmarks.metaworld.features import View
from benchmarks.metaworld.learners import TITLES
from benchmarks.metaworld.results import Cell, Result
from pacnet.evaluation.figure_style import BLUE, GREEN, GREY, INK, VERMILION, new_figure, tidy

PATH = Path(__file__).parents[2] / "docs" / "images" / "metaworld.png"
LINK = f"![Success over the number of demonstrations, one line a learner](images/{PATH.name})"
STYLES = {
    "pacnet": (VERMILION, "o-"),
    "nearest": (BLUE, "s-"),
    "replay": (GREY, "^:"),
    "local": (BLUE, "D--"),
    "bc": (GREEN, "v-"),
    "darp": (INK, "x--"),
}


def draw(found: Mapping[Cell, Result]) -> None:
    """Draw a line for each learner, one panel for each set of tasks, seen as usual."""
    usual = {cell: result for cell, result in found.items() if cell.view == View()}
    sets = [n for n in report.SETS if any(tasks.set_of(cell.task) == n for cell in usual)]
    figure = new_figure(4.2 * len(sets), 3.4)
    panels = figure.subplots(1, len(sets), squeeze=False, sharey=True)[0]
    for axes, name in zip(panels, sets, strict=True):
        of_set = {c: r for c, r in usual.items() if tasks.set_of(c.task) == name}
        counts = sorted({cell.demonstrations for cell in of_set})
        for learner in report.learners_of(of_set):
            points = [(n, report.success(_shown(of_set, n), learner)) for n in counts]
            known = [(n, 100 * share) for n, share in points if share is not None]
            (colour, line), title = STYLES[learner], TITLES[learner].strip("`")
            if known:
                axes.plot(*zip(*known, strict=True), line, color=colour, label=title)
        heading = f"{name}: {len({cell.task for cell in of_set})} tasks"
        tidy(axes, heading, "demonstrations", "success [%]" if axes is panels[0] else "")
        axes.set_xscale("log")
        axes.set_xticks(counts, map(str, counts))
        axes.minorticks_off()
        axes.set_ylim(0, 100)
    panels[-1].legend(frameon=False, fontsize=8)
    figure.savefig(PATH)


def _shown(found: Mapping[Cell, Result], number: int) -> dict[Cell, Result]:
    """Return the results with so many demonstrations."""
    return {cell: result for cell, result in found.items() if cell.demonstrations == number}
