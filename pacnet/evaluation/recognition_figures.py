"""The figure of one recognized episode over time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from pacnet.competition.recognition import Recognition
from pacnet.evaluation.figure_style import (
    COLOURS,
    GREY,
    INK,
    LABEL_SIZE,
    new_figure,
    rows_by_first_win,
    tidy,
    wrapped,
)

_HATCHES = ("", "///", "...", "xxx")  # the last three from the seventh behaviour on
_NUMBERED_NODES = 40  # of more nodes, only some are numbered
_ROW = 0.12  # height of a row whose node is numbered [inches]
_LINE = 0.17  # height of a line of the legend [inches]
_TITLE_WIDTH = 80  # [characters]


def recognition_over_time(
    recognition: Recognition,
    behaviours: Sequence[str],
    threshold: float,
    timestep: float,
    title: str,
    acts: NDArray[np.bool_] | None = None,
) -> Figure:
    """Draw behaviour, progress, novelty and winners of an episode over time.

    The dashed line is progress at a steady pace. Progress and winners have the colour of the most
    probable behaviour at that time. Novel stretches are shaded.

    Args:
        recognition: of the episode's T samples, from its start.
        behaviours: title of each known behaviour `[B]`.
        threshold: novelty above which a sample is novel.
        timestep: time from one sample to the next [s].
        title: of the figure.
        acts: whether the robot would act `[T]`, to mark where it would hold.

    Raises:
        ValueError: not one title for each behaviour, or a timestep that is not positive.
    """
    known = recognition.probability.shape[1]
    if len(behaviours) != known:
        raise ValueError(f"expected titles of {known} behaviours, got {list(behaviours)}")
    if not timestep > 0:
        raise ValueError(f"expected timestep > 0 [s], got {timestep}")
    edges = timestep * np.arange(len(recognition.behaviour) + 1)  # of the samples [T + 1] [s]
    seconds = edges[:-1]
    named, winners = recognition.behaviour.numpy(), recognition.winner.numpy()
    legend, columns = _legend(behaviours, acts is not None)
    rows = min(len(set(winners.tolist())), _NUMBERED_NODES) * _ROW  # [inches]
    figure = new_figure(8.5, 6.8 + max(0.0, rows - 1.3) + _height(legend, columns))
    figure.suptitle(wrapped(title, _TITLE_WIDTH), x=0.01, ha="left", fontsize=12)
    heights = (1.3, 1.3, 1.1, max(1.3, rows))
    panels = figure.subplots(4, 1, sharex=True, height_ratios=heights)
    _draw_probabilities(panels[0], edges, recognition.probability.numpy())
    _draw_progress(panels[1], seconds, recognition.progress.numpy(), named)
    _draw_novelty(panels[2], seconds, recognition.novelty.numpy(), threshold)
    _draw_winners(panels[3], seconds, winners, named)
    novel = recognition.is_novel.numpy()
    for axes in panels[1:]:
        _fill(axes, edges, novel, (0, 1), color=GREY, alpha=0.3, zorder=0)
    if acts is not None:
        _draw_holds(panels[2], edges, ~acts)
    panels[-1].set_xlim(0, edges[-1])
    panels[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    figure.legend(handles=legend, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _draw_probabilities(axes: Axes, edges: NDArray, probability: NDArray) -> None:
    tidy(axes, "Probability of each known behaviour", "", "probability")
    tops = np.cumsum(np.vstack([np.zeros(len(probability)), *probability.T]), axis=0)  # [B + 1, T]
    tops = np.column_stack([tops, tops[:, -1]])  # up to the end of the last sample
    for number, (below, above) in enumerate(pairwise(tops)):
        axes.fill_between(
            edges, below, above, facecolor=_colour(number), hatch=_hatch(number),
            edgecolor="white", linewidth=0, step="post",
        )  # fmt: skip
    axes.set_ylim(0, 1)
    axes.yaxis.set_major_formatter(PercentFormatter(1))


def _draw_progress(axes: Axes, seconds: NDArray, progress: NDArray, named: NDArray) -> None:
    tidy(axes, "Progress in the most probable behaviour", "", "progress")
    axes.plot(seconds[[0, -1]], (0, 1), "--", color=INK, linewidth=1)
    _dots(axes, seconds, progress, named)
    axes.set_ylim(-0.03, 1.03)
    axes.yaxis.set_major_formatter(PercentFormatter(1))


def _draw_novelty(axes: Axes, seconds: NDArray, novelty: NDArray, threshold: float) -> None:
    tidy(axes, "Novelty", "", "novelty")
    marker = "." if len(seconds) == 1 else None  # a line needs two
    axes.plot(
        seconds, novelty, marker=marker, markersize=9, color=INK, linewidth=1.2, clip_on=False
    )
    axes.axhline(threshold, color=INK, linestyle=":", linewidth=1.4)
    axes.set_ylim(0, max(1, 1.05 * float(novelty.max(initial=0, where=np.isfinite(novelty)))))


def _draw_holds(axes: Axes, edges: NDArray, holds: NDArray) -> None:
    """Draw a band below the curve where the robot would hold."""
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom - 0.16 * (top - bottom), top)
    axes.axhline(bottom, color=GREY, linewidth=0.6)
    _fill(axes, edges, holds, (0, 0.1), facecolor=INK, zorder=2)


def _draw_winners(axes: Axes, seconds: NDArray, winners: NDArray, named: NDArray) -> None:
    """Draw a row for each node, in the order of first wins; samples without a match below."""
    tidy(axes, "Winning nodes, by first win", "", "node")
    row_of = rows_by_first_win(winners)
    no_match = -max(1, 0.12 * len(row_of))  # the row below, far enough for its name
    rows = np.array([row_of.get(node, no_match) for node in winners.tolist()])
    won = winners >= 0
    _dots(axes, seconds[won], rows[won], named[won])
    every = -(-len(row_of) // _NUMBERED_NODES) or 1
    ticks = {float(row): str(node) for node, row in row_of.items() if row % every == 0}
    if not won.all():  # an empty line that is not clipped would upset the layout
        axes.plot(seconds[~won], rows[~won], "x", color=INK, markersize=4, clip_on=False)
        ticks[no_match] = "no match"
    axes.set_yticks(list(ticks), list(ticks.values()), fontsize=LABEL_SIZE)
    axes.set_ylim(min(ticks) - 0.6, max(len(row_of), 1) - 0.4)


def _dots(axes: Axes, seconds: NDArray, values: NDArray, named: NDArray) -> None:
    """Draw samples in the colour of their most probable behaviour."""
    for number in np.unique(named):
        own = named == number
        axes.plot(
            seconds[own], values[own], ".", color=_colour(number), markersize=4, clip_on=False
        )


def _fill(
    axes: Axes, edges: NDArray, where: NDArray, heights: tuple[float, float], **style: Any
) -> None:
    """Fill the samples where a condition holds, between two shares of the panel's height."""
    axes.fill_between(
        np.repeat(edges, 2)[1:-1], *heights, where=np.repeat(where, 2),
        transform=axes.get_xaxis_transform(), linewidth=0, **style,
    )  # fmt: skip


def _legend(behaviours: Sequence[str], shows_holds: bool) -> tuple[list[Patch | Line2D], int]:
    """Return the entries and the number of columns."""
    columns = 3 if max(map(len, behaviours)) <= 30 else 2
    shares = [
        Patch(
            facecolor=_colour(number), hatch=_hatch(number), edgecolor="white",
            label=wrapped(title, 90 // columns),
        )
        for number, title in enumerate(behaviours)
    ]  # fmt: skip
    holds = [Patch(facecolor=INK, label="would hold, not act")] if shows_holds else []
    entries = [
        *shares,
        Line2D([], [], color=INK, linestyle="--", linewidth=1, label="steady pace"),
        Line2D([], [], color=INK, linestyle=":", linewidth=1.4, label="novelty threshold"),
        Patch(facecolor=GREY, alpha=0.3, label="novel"),
        *holds,
    ]
    return entries, columns


def _height(legend: Sequence[Patch | Line2D], columns: int) -> float:
    """Return the height of a legend [inches]."""
    lines = [str(entry.get_label()).count("\n") + 1.5 for entry in legend]
    return _LINE * max(part.sum() for part in np.array_split(lines, columns))


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _hatch(number: int) -> str:
    return _HATCHES[number // len(COLOURS) % len(_HATCHES)]
