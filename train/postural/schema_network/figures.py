"""Figures of the schema network and PACNet: winners over time, confidences, switches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.arrays import finite_array, integer_series
from pacnet.evaluation.figure_style import (
    BLUE,
    GREY,
    INK,
    LABEL_SIZE,
    VERMILION,
    new_figure,
    rows_by_first_win,
    tidy,
)
from train.postural.winners import switches

# A system without and with hysteresis; by hand, by attention, PACNet.
_SHADES = (VERMILION, "#f0b48c", GREY, BLUE, "#8cc4e8")
_BAR = 6  # [pt] thickness of a winner's bar


class Behaviour(NamedTuple):
    """The behaviour shown in a panel."""

    name: str
    phases: Sequence[str]  # [T]
    schemas: Sequence[int]  # that it consists of, numbered from 1


def winners_and_confidences(
    shown: Behaviour,
    winners: ArrayLike,
    confidences: ArrayLike,
    timestep: float,
    rivals: Sequence[int],
) -> Figure:
    """Draw the winners of the schema network over time (Figure 2), and some confidences.

    Args:
        shown: The behaviour.
        winners: Schema, from 1, that wins each sample, negative for none `[T]`.
        confidences: Of each schema `[T, S]`.
        timestep: Time from one sample to the next [s].
        rivals: Schemas whose confidences are drawn, from 1.

    Raises:
        ValueError: Winners that are not integers `[T]`, or confidences of another length.
    """
    won = integer_series("winners", winners)
    values = finite_array("confidences", confidences, (len(won), "S"))
    figure = new_figure(9, 6.6)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    title = f"Output of the schema network, shown {shown.name}: {_chain(shown.schemas)}"
    tidy(top, title, "", "winning schema")
    _draw_schemas(top, won, timestep, shown.schemas, values.shape[1])
    _mark_phases(top, shown.phases, timestep, named=True)
    names = " and ".join(map(str, rivals))
    tidy(bottom, f"Confidence of schemas {names}", "time [s]", "confidence")
    seconds = np.arange(len(won)) * timestep
    for schema in rivals:
        colour = BLUE if schema in shown.schemas else VERMILION
        bottom.plot(
            seconds, values[:, schema - 1], color=colour, linewidth=0.9, label=f"schema {schema}"
        )
    bottom.set_ylim(0, 1.2)  # leaves space for the legend
    bottom.set_yticks(np.linspace(0, 1, 6))
    bottom.legend(loc="upper center", frameon=False, ncols=len(rivals))
    _mark_phases(bottom, shown.phases, timestep, named=False)
    _explain_colours(figure)
    return figure


def side_by_side(
    panels: Sequence[tuple[Behaviour, Mapping[str, ArrayLike]]], timestep: float, schemas: int
) -> Figure:
    """Draw the winners over time of two systems in the same episodes.

    Args:
        panels: For each row the behaviour, and system -> winners `[T]`; schemas count from 1, nodes
            from 0.
        timestep: Time from one sample to the next [s].
        schemas: Number of the schema network's schemas.

    Raises:
        ValueError: Winners that are not integers `[T]`.
    """
    figure = new_figure(11, 2.9 * len(panels))
    grid = figure.subplots(len(panels), 2, squeeze=False)
    for row, (shown, systems) in zip(grid, panels, strict=True):
        for axes, (system, value) in zip(row, systems.items(), strict=True):
            won = integer_series("winners", value)
            title = f"{shown.name}: {switches(won)} switches of {system}"
            tidy(axes, title, "time [s]" if row is grid[-1] else "", "")
            if axes is row[0]:
                _draw_schemas(axes, won, timestep, shown.schemas, schemas)
                axes.set_ylabel("winning schema")
            else:
                _draw_nodes(axes, won, timestep)
            _mark_phases(axes, shown.phases, timestep, named=True)
    _explain_colours(figure)
    return figure


def switches_per_episode(means: Mapping[str, Mapping[str, float]]) -> Figure:
    """Draw the mean number of switches per episode of up to five systems.

    Args:
        means: System -> behaviour -> number.
    """
    behaviours = list(next(iter(means.values())))
    figure = new_figure(8, 1.2 + 0.32 * len(behaviours) * len(means))
    axes = figure.subplots()
    tidy(axes, "Changes of the winner per episode", "mean number of changes (log scale)", "")
    height = 0.8 / len(means)
    rows = np.arange(len(behaviours))
    for place, ((system, values), colour) in enumerate(zip(means.items(), _SHADES, strict=False)):
        numbers = [values[behaviour] for behaviour in behaviours]
        bars = axes.barh(
            rows + (place - (len(means) - 1) / 2) * height,
            numbers,
            height,
            color=colour,
            label=system,
        )
        axes.bar_label(bars, fmt="{:.1f}", padding=3, size=LABEL_SIZE)
    axes.set_xscale("log")
    axes.set_xlim(1, 1.6 * max(max(values.values()) for values in means.values()))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_yticks(rows, behaviours)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def _draw_schemas(
    axes: Axes, winners: NDArray, timestep: float, expected: Sequence[int], schemas: int
) -> None:
    """Draw a row for each schema: those of the shown behaviour in blue, others in vermilion."""
    numbers = range(1, schemas + 1)
    colours = {schema: BLUE if schema in expected else VERMILION for schema in numbers}
    _draw_runs(axes, winners, timestep, {schema: schema for schema in numbers}, colours)
    axes.set_yticks(numbers)
    _set_rows(axes, 1, schemas)
    for label, schema in zip(axes.get_yticklabels(), numbers, strict=True):
        label.set_color(BLUE if schema in expected else GREY)
        label.set_fontsize(LABEL_SIZE)


def _draw_nodes(axes: Axes, winners: NDArray, timestep: float) -> None:
    """Draw a row for each node, in the order of first wins."""
    rows = rows_by_first_win(winners)
    _draw_runs(axes, winners, timestep, rows, dict.fromkeys(rows, INK))
    axes.set_yticks(range(len(rows)), [str(node) for node in rows])
    axes.tick_params(axis="y", labelsize=LABEL_SIZE)
    _set_rows(axes, 0, max(len(rows) - 1, 0))
    axes.set_ylabel("winning node, by first win")


def _draw_runs(
    axes: Axes,
    winners: NDArray,
    timestep: float,
    rows: Mapping[int, int],
    colours: Mapping[int, str],
) -> None:
    """Draw a bar from the first sample of each run of wins to the next run."""
    start = 0
    for winner, run in groupby(winners.tolist()):
        end = start + len(list(run))
        if winner >= 0:
            axes.hlines(
                rows[winner], start * timestep, end * timestep, colours[winner], linewidth=_BAR
            )
        start = end


def _set_rows(axes: Axes, first: int, last: int) -> None:
    """Put the first row on top, as in the paper; leave space for the phases' names below."""
    axes.set_ylim(last + 0.6 + 0.27 * (last - first + 1), first - 0.7)


def _mark_phases(axes: Axes, phases: Sequence[str], timestep: float, named: bool) -> None:
    """Draw a faint line where a phase ends, and its name at the bottom."""
    axes.grid(visible=False, axis="x")
    start = 0
    for name, run in groupby(phases):
        end = start + len(list(run))
        axes.axvline(end * timestep, color=INK, alpha=0.25, linewidth=0.7)
        if named and name != "rest":
            place = ((start + end) / 2 * timestep, 0.0)
            axes.annotate(
                name, place, (0, 3), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="center", va="bottom", size=LABEL_SIZE - 1,
                color=INK, rotation=90,
            )  # fmt: skip
        start = end
    axes.set_xlim(0, start * timestep)


def _explain_colours(figure: Figure) -> None:
    """Add a legend of blue and vermilion winners."""
    handles = [Line2D([], [], color=colour, linewidth=_BAR) for colour in (BLUE, VERMILION)]
    names = ("schema of the shown behaviour", "schema of another behaviour")
    figure.legend(handles, names, loc="outside lower center", ncols=2, frameon=False)


def _chain(schemas: Sequence[int]) -> str:
    return "-".join(map(str, schemas))
