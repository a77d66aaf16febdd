"""The results of what is worth remembering: tables and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from pacnet.evaluation.figure_style import COLOURS, GREY, INK, new_figure, tidy
from train.common.summary import Summary, mean_and_std
from train.remembering import walls
from train.remembering.alone import ALL, OURS
from train.remembering.alone import ROWS as ALONE_ROWS
from train.remembering.cues import PACNET
from train.remembering.cues import ROWS as CUES_ROWS
from train.remembering.replicates import ALONE, BUDGET, BUDGETS, CUES, CURVE, WALLS
from train.remembering.rules import RULES
from train.remembering.streams import PLAIN, RESTS, STREAMS

Scores = Mapping[str, Mapping[str, Summary]]


def print_tables(scores: Scores) -> None:
    """Print success, errors and wall following of each rule, as far as they were measured."""
    columns = [(stream, BUDGET) for stream in STREAMS]
    if ALONE in scores:
        print(f"\nalone, {BUDGET} targets kept: success")
        _print(scores[ALONE], ALONE_ROWS, columns, 2)
    if CUES in scores:
        print(f"\nfrom watching, {BUDGET} targets kept: error of the nearest cue's target [deg]")
        _print(scores[CUES], CUES_ROWS, columns, 2)
        print("\nthe same after rests, by the number of targets")
        _print(scores[CUES], CUES_ROWS, [(RESTS, budget) for budget in BUDGETS], 2)
    if WALLS in scores:
        print(f"\nfollowing walls alone, {walls.BUDGET} targets kept, mean of the k nearest")
        columns = [(walls.RESTS, f"{k}-NN {one}") for k in walls.COUNTS for one in walls.SCORES]
        _print(scores[WALLS], walls.ROWS, columns, 2)


def _print(
    scores: Mapping[str, Summary],
    rows: Sequence[str],
    columns: Sequence[tuple[str, int | str]],
    digits: int,
) -> None:
    print(f"{'':34}" + "".join(f"{f'{stream}, {what}':>26}" for stream, what in columns))
    for row in rows:
        cells = [f"{stream} | {what} | {row}" for stream, what in columns]
        print(f"{row:34}" + "".join(f"{mean_and_std(scores[c], digits):>26}" for c in cells))


def draw(scores: Scores) -> Figure:
    """Draw success alone and the error of a target over the number of targets kept."""
    figure = new_figure(11, 6.2)
    grid = figure.subplots(2, 2, sharex=True)
    for column, stream in enumerate((PLAIN, RESTS)):
        panels = (ALONE, CURVE, "success alone"), (CUES, BUDGETS, "error of a target [deg]")
        for axes, (experiment, budgets, label) in zip(grid[:, column], panels, strict=True):
            tidy(axes, stream if experiment == ALONE else "", "targets kept", label)
            for row, style in _styles().items():
                values = [scores[experiment].get(f"{stream} | {b} | {row}") for b in budgets]
                known = [value["mean"] for value in values if value is not None]
                if known:
                    axes.plot(budgets, known, label=row, **style)
            axes.set_xscale("log")
            axes.set_xticks(BUDGETS, [str(budget) for budget in BUDGETS])
    grid[1][0].set_ylim(0, 12)
    grid[1][1].set_ylim(0, 12)
    handles, labels = grid[1][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", frameon=False)
    return figure


def _styles() -> dict[str, dict[str, object]]:
    """Return how each row is drawn."""
    styles: dict[str, dict[str, object]] = {
        OURS: {"color": INK, "linewidth": 2.5},
        PACNET: {"color": INK, "linestyle": "--", "linewidth": 2},
    }
    lines = ("-", ":")
    for number, row in enumerate(RULES):
        colour = COLOURS[number % len(COLOURS)]
        styles[row] = {"color": colour, "linestyle": lines[number // len(COLOURS) % 2]}
    return styles | {ALL: {"color": GREY, "linewidth": 2}}
