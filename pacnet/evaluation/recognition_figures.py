"""The figure of one recognised episode over time, from arrays."""

from __future__ import annotations

import textwrap
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
    BLUE,
    GREEN,
    GREY,
    INK,
    LABEL_SIZE,
    VERMILION,
    literal,
    new_figure,
    tidy,
    winner_series,
)

# Okabe & Ito's, the lightest last; a seventh behaviour starts again, hatched.
_COLOURS = (BLUE, VERMILION, GREEN, "#cc79a7", "#56b4e9", "#e69f00")
_HATCHES = ("", "///", "...", "xxx")
_NUMBERED_NODES = 40  # most whose numbers are written beside their rows
_ROW = 0.12  # of a node whose number is written [inches]
_LINE = 0.17  # of the legend [inches]
_TITLE_WIDTH = 80  # letters


def recognition_over_time(
    recognition: Recognition,
    behaviours: Sequence[str],
    threshold: float,
    timestep: float,
    title: str,
    acts: NDArray[np.bool_] | None = None,
) -> Figure:
    """What was recognised in an episode: behaviour, progress, novelty and winners over time.

    Progress is drawn against a steady pace from the first to the last sample; progress and winners
    have the colour of the behaviour that is the most probable at that time. Novel stretches are
    shaded.

    Args:
        recognition: of the episode's T samples, from its start.
        behaviours: title of each known behaviour [B].
        threshold: of novelty.
        timestep: Time from one sample to the next [s].
        title: of the figure.
        acts: whether the robot would act [T], to mark where it would hold.

    Raises:
        ValueError: Not one title for each behaviour, or a timestep that is not positive.
    """
    known = recognition.probability.shape[1]
    if len(behaviours) != known:
        raise ValueError(f"expected titles of {known} behaviours, got {list(behaviours)}")
    if not timestep > 0:
        raise ValueError(f"expected timestep > 0 [s], got {timestep}")
    seconds = timestep * np.arange(len(recognition.behaviour))
    named, winners = recognition.behaviour.numpy(), winner_series(recognition.winner.numpy())
    legend, columns = _legend(behaviours, acts is not None)
    rows = min(len(set(winners.tolist())), _NUMBERED_NODES) * _ROW  # [inches]
    figure = new_figure(8.5, 6.8 + max(0.0, rows - 1.3) + _height(legend, columns))
    figure.suptitle(_wrapped(title, _TITLE_WIDTH), x=0.01, ha="left", fontsize=12)
    heights = (1.3, 1.3, 1.1, max(1.3, rows))
    panels = figure.subplots(4, 1, sharex=True, height_ratios=heights)
    _draw_probabilities(panels[0], seconds, timestep, recognition.probability.numpy())
    _draw_progress(panels[1], seconds, recognition.progress.numpy(), named)
    _draw_novelty(panels[2], seconds, recognition.novelty.numpy(), threshold)
    _draw_winners(panels[3], seconds, winners, named)
    for axes in panels[1:]:
        _shade(axes, seconds, timestep, recognition.is_novel.numpy())
    if acts is not None:
        _draw_holds(panels[2], seconds, timestep, ~acts)
    panels[-1].set_xlim(0, seconds[-1] + timestep)
    panels[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    figure.legend(handles=legend, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _draw_probabilities(
    axes: Axes, seconds: NDArray, timestep: float, probability: NDArray
) -> None:
    tidy(axes, "Probability of each known behaviour", "", "probability")
    edges = np.append(seconds, seconds[-1] + timestep)
    tops = np.cumsum(np.vstack([np.zeros(len(seconds)), *probability.T]), axis=0)  # [B + 1, T]
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
    axes.set_ylim(0, max(1, 1.05 * float(novelty.max())))


def _draw_holds(axes: Axes, seconds: NDArray, timestep: float, holds: NDArray) -> None:
    """A band under the curve."""
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom - 0.16 * (top - bottom), top)
    axes.axhline(bottom, color=GREY, linewidth=0.6)
    _fill(axes, seconds, timestep, holds, (0, 0.1), facecolor=INK, zorder=2)


def _draw_winners(axes: Axes, seconds: NDArray, winners: NDArray, named: NDArray) -> None:
    """A row a node, in the order in which they first win; no match in a row below."""
    tidy(axes, "Winning nodes, by first win", "", "node")
    order = [node for node in dict.fromkeys(winners.tolist()) if node >= 0]
    row_of = {node: row for row, node in enumerate(order)}
    nobody = -max(1, 0.12 * len(order))  # the row below, far enough for its name
    rows = np.array([row_of.get(node, nobody) for node in winners.tolist()])
    won = winners >= 0
    _dots(axes, seconds[won], rows[won], named[won])
    every = -(-len(order) // _NUMBERED_NODES) or 1
    ticks = {float(row): str(order[row]) for row in range(0, len(order), every)}
    if not won.all():  # an empty line that is not clipped would upset the layout
        axes.plot(seconds[~won], rows[~won], "x", color=INK, markersize=4, clip_on=False)
        ticks[nobody] = "no match"
    axes.set_yticks(list(ticks), list(ticks.values()), fontsize=LABEL_SIZE)
    axes.set_ylim(min(ticks) - 0.6, max(len(order), 1) - 0.4)


def _dots(axes: Axes, seconds: NDArray, values: NDArray, named: NDArray) -> None:
    """Samples, in the colour of the behaviour that each was named."""
    for number in np.unique(named):
        own = named == number
        axes.plot(
            seconds[own], values[own], ".", color=_colour(number), markersize=4, clip_on=False
        )


def _shade(axes: Axes, seconds: NDArray, timestep: float, novel: NDArray) -> None:
    _fill(axes, seconds, timestep, novel, (0, 1), color=GREY, alpha=0.3, zorder=0)


def _fill(
    axes: Axes,
    seconds: NDArray,
    timestep: float,
    where: NDArray,
    heights: tuple[float, float],
    **style: Any,
) -> None:
    """Samples for which something is so, between two heights in shares of the panel's."""
    edges = np.append(seconds, seconds[-1] + timestep)
    axes.fill_between(
        np.repeat(edges, 2)[1:-1], *heights, where=np.repeat(where, 2),
        transform=axes.get_xaxis_transform(), linewidth=0, **style,
    )  # fmt: skip


def _legend(behaviours: Sequence[str], shows_holds: bool) -> tuple[list[Patch | Line2D], int]:
    """The entries, and in how many columns they fit."""
    columns = 3 if max(map(len, behaviours)) <= 30 else 2
    shares = [
        Patch(
            facecolor=_colour(number), hatch=_hatch(number), edgecolor="white",
            label=_wrapped(title, 90 // columns),
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
    """Of the entries in so many columns [inches]."""
    lines = [str(entry.get_label()).count("\n") + 1.5 for entry in legend]
    return _LINE * max(part.sum() for part in np.array_split(lines, columns))


def _wrapped(text: str, width: int) -> str:
    """On three lines at most."""
    lines = textwrap.wrap(literal(text), width, max_lines=3, placeholder=" …")
    return "\n".join(lines)


def _colour(number: int) -> str:
    return _COLOURS[number % len(_COLOURS)]


def _hatch(number: int) -> str:
    return _HATCHES[number // len(_COLOURS) % len(_HATCHES)]
