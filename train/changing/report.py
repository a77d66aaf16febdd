"""The results of a world that changes: tables and figures."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from pacnet.evaluation.figure_style import COLOURS, GREY, INK, new_figure, tidy
from train.changing.drink import ONE_WORLD, STAGES
from train.changing.drink import ROWS as DRINK_ROWS
from train.changing.gain import (
    ANEW,
    FORGETTING,
    HOLDING,
    NEAREST,
    NEVER,
    ROWS,
    TIMES,
    TWO_MINUTES,
    WINDOWS,
)
from train.common.summary import Summary

Table = Mapping[str, Summary]


def draw_gain(scores: Table) -> Figure:
    """Draw each row's error after a change of gain, on the new world and on the old one."""
    figure = new_figure(9, 3.8)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, score, title in zip(
        panels,
        ("error", "error_before"),
        ("A gain of .5, after the change", "The first gain, meanwhile"),
        strict=True,
    ):
        tidy(axes, title, "time after the change [s]", "error of the target, mean of a reading")
        for row, style in _styles().items():
            errors = [scores[f"{row} | {time} | {score}"]["mean"] for time in TIMES]
            axes.plot([time / 10 for time in TIMES], errors, label=row, **style)
    panels[1].set_ylabel("")
    handles = panels[0].get_legend_handles_labels()
    key = {"loc": "outside right center", "frameon": False, "title": "in steps of 0.1 s"}
    figure.legend(*handles, **key)
    return figure


def _styles() -> dict[str, dict[str, object]]:
    """Return how each row is drawn: one colour for an interval, as forgetting and as a window."""
    styles: dict[str, dict[str, object]] = {}
    for rows, line in ((FORGETTING, "-"), (WINDOWS, ":")):
        for row, colour in zip(rows, COLOURS, strict=False):
            styles[row] = {"color": colour, "linestyle": line}
    styles[NEVER] = {"color": INK, "linewidth": 2}
    styles[ANEW] = {"color": INK, "linestyle": "--", "linewidth": 2}
    styles[NEAREST], styles[HOLDING] = {"color": GREY}, {"color": GREY, "linestyle": ":"}
    return {row: styles[row] for row in ROWS}


def print_gain(scores: Table) -> None:
    """Print each row's error over time, and after two minutes the rest."""
    head = "".join(f"{f'{time / 10:g} s':>9}" for time in TIMES)
    print(f"\n{'a reading at half its gain: error':34}{head}{'of anew':>9}{'before':>9}{'kept':>8}")
    for row in ROWS:
        errors = "".join(f"{scores[f'{row} | {time} | error']['mean']:9.4f}" for time in TIMES)
        now = f"{row} | {TWO_MINUTES}"
        print(
            f"{row:34}{errors}{scores[f'{row} | of anew']['mean']:9.2f}"
            f"{scores[f'{now} | error_before']['mean']:9.4f}"
            f"{scores[f'{now} | targets']['mean']:8.0f}"
        )


def print_drink(scores: Table) -> None:
    """Print how often each way succeeds at each stage, and how many targets are kept."""
    for name, stage in STAGES.items():
        ways = stage.wanted
        print(f"\n{name:34}" + "".join(f"{way:>15}" for way in ways) + f"{'kept':>9}{'of one':>8}")
        for row in DRINK_ROWS:
            cells = [f"{name} | {row} | {way}" for way in ways]
            kept, first = (f"{stage} | {row} | targets" for stage in (name, ONE_WORLD))
            if kept not in scores and not any(cell in scores for cell in cells):
                continue
            line = "".join(_share(scores.get(cell)) for cell in cells)
            if kept in scores:
                ratio = scores[kept]["mean"] / scores[first]["mean"]
                line += f"{scores[kept]['mean']:9.0f}{ratio:8.2f}"
            print(f"{row:34}{line}")


def _share(score: Summary | None) -> str:
    return f"{'':15}" if score is None else f"{score['mean']:9.3f} ±{score['std']:.2f}"
