"""Figures of those who act alone: winners of one map for both bodies, and places of the glass."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Wedge
from numpy.typing import ArrayLike, NDArray

from envs.glass_offset import DIRECTIONS
from envs.scene import GLASS_PLACE
from pacnet.evaluation.arrays import finite_array, integer_series
from pacnet.evaluation.figure_style import (
    BLUE,
    GREEN,
    GREY,
    VERMILION,
    new_figure,
    rows_by_first_win,
    tidy,
)
from train.postural.alone.scenes import RADIUS


def mirror_winners(
    winners: Mapping[str, ArrayLike],
    grasps: Mapping[str, tuple[int, int]],
    node: int,
    timestep: float,
) -> Figure:
    """Draw the winners of one map while one body acts and while the other does.

    Time is counted from each body's grasp. Rows are in the order in which the nodes first win.

    Args:
        winners: Title of a panel -> node that wins each sample `[T]`.
        grasps: The same titles -> first sample of the grasp, and the one after its last.
        node: That stands for the grasp; its row is marked.
        timestep: From one sample to the next [s].

    Raises:
        ValueError: Winners that are not integers `[T]`.
    """
    panels = {title: integer_series("winners", series) for title, series in winners.items()}
    row_of = rows_by_first_win(*panels.values())
    figure = new_figure(7.5, 1.0 + 2.2 * len(panels))
    grid = figure.subplots(len(panels), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, (title, series) in zip(grid, panels.items(), strict=True):
        first, last = grasps[title]
        seconds = (np.arange(len(series)) - first) * timestep
        axes.axvspan(0, (last - first) * timestep, color=VERMILION, alpha=0.2, linewidth=0)
        axes.axhspan(row_of[node] - 0.5, row_of[node] + 0.5, color=GREY, alpha=0.2, linewidth=0)
        axes.plot(seconds, [row_of[winner] for winner in series], ".", color=BLUE, markersize=4)
        tidy(axes, title, "", "winning node")
    grid[0].set_yticks(range(len(row_of)), [str(number) for number in row_of])
    grid[-1].set_xlabel("time from the grasp [s]")
    return figure


def places_tried(tried: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> Figure:
    """Draw where the glass stood, from above, and whether there was a drink.

    Args:
        tried: Title of a panel -> offsets of the glass from its usual place `[N, 2]` [m], forwards
            and to the left, and success `[N]`.

    Raises:
        ValueError: Arrays of other shapes, or not finite.
    """
    figure = new_figure(4.4 * len(tried), 4.8)
    grid = figure.subplots(1, len(tried), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (title, (offsets, success)) in zip(grid, tried.items(), strict=True):
        places = finite_array("offsets", offsets, ("N", 2)) + GLASS_PLACE
        drunk = finite_array("success", np.asarray(success, float), (len(places),)) > 0
        tidy(axes, f"{title}: {drunk.sum()} of {len(drunk)}", "to the left [m]", "")
        _draw_reach(axes)
        _dots(axes, places[drunk], GREEN, "o", "drank")
        _dots(axes, places[~drunk], VERMILION, "x", "did not")
        axes.set_aspect("equal")
    grid[0].set_ylabel("forwards from the body [m]")
    grid[0].invert_xaxis()  # as the robot sees it: its left on the left
    handles, names = grid[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _dots(axes: Axes, places: NDArray, colour: str, marker: str, label: str) -> None:
    """Draw places `[N, 2]`, forwards upwards and the left positive."""
    axes.scatter(places[:, 1], places[:, 0], color=colour, marker=marker, s=22, label=label)


def _draw_reach(axes: Axes) -> None:
    """Draw where a glass may stand, and where it stood in the demonstrations."""
    forwards, left = GLASS_PLACE
    # Directions count from forwards to the left: here from the second axis towards the first.
    last, first = (90 - math.degrees(direction) for direction in DIRECTIONS)
    reach = Wedge((left, forwards), RADIUS, first, last, color=GREY, alpha=0.2, label="drawn from")
    axes.add_patch(reach)
    axes.add_patch(Circle((left, forwards), 0.014, color=BLUE, alpha=0.5, label="shown"))
