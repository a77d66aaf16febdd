"""The paper's figures of a map, each a function from arrays to a matplotlib Figure.

Save one with `figure.savefig(path)`.
"""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.arrays import finite_array, integer_series
from pacnet.evaluation.figure_style import (
    BLUE,
    GREY,
    VERMILION,
    component_axes,
    new_figure,
    number_nodes,
    rows_by_first_win,
    tidy,
)


def percepts_on_components(
    percepts: ArrayLike, times: ArrayLike, variance_ratio: ArrayLike
) -> Figure:
    """Draw percepts on their two principal components, coloured by time (Figures 6a, 9a).

    Args:
        percepts: projected percepts `[T, 2]`.
        times: time of each within its episode `[T]` [s].
        variance_ratio: share of the variance on each component, two or more.

    Raises:
        ValueError: arrays of other shapes, or not finite.
    """
    points = finite_array("percepts", percepts, ("T", 2))
    seconds = finite_array("times", times, (len(points),))
    title = f"Percepts on two principal components ({len(points):,} samples)"
    figure, axes = component_axes(title, variance_ratio)
    dots = axes.scatter(*points.T, c=seconds, cmap="viridis", s=7, linewidths=0)
    figure.colorbar(dots, ax=axes, label="time in episode [s]", pad=0.02)
    return figure


def map_on_components(
    nodes: ArrayLike, edges: ArrayLike, percepts: ArrayLike, variance_ratio: ArrayLike
) -> Figure:
    """Draw the map on the percepts' two principal components (Figures 6b, 9b).

    Args:
        nodes: projected nodes `[N, 2]`, numbered by their row; N may be 0.
        edges: the two nodes that each edge joins `[E, 2]`.
        percepts: projected percepts, drawn faintly behind `[T, 2]`.
        variance_ratio: share of the variance on each component, two or more.

    Raises:
        ValueError: arrays of other shapes, not finite, or an edge to a node that does not exist.
    """
    places = finite_array("nodes", nodes, ("N", 2))
    joined = edge_ends(edges, len(places))
    points = finite_array("percepts", percepts, ("T", 2))
    title = f"Map on two principal components ({len(places)} nodes, {len(joined)} edges)"
    figure, axes = component_axes(title, variance_ratio)
    axes.scatter(*points.T, color=GREY, alpha=0.25, s=5, linewidths=0, zorder=1)
    axes.add_collection(LineCollection(list(places[joined]), colors=BLUE, linewidths=1.2, zorder=2))
    axes.scatter(*places.T, color=BLUE, edgecolors="white", s=36, zorder=3)
    number_nodes(figure, axes, places)
    return figure


def winners_over_time(
    winners: ArrayLike, timestep: float, demonstration: ArrayLike | None = None
) -> Figure:
    """Draw the winning node at each sample (Figures 6c, 9c).

    Each node has a row. Rows are in the order in which the nodes first win, in the demonstration if
    there is one; a sequence of actions then climbs like a staircase.

    Args:
        winners: node that wins each sample, negative for no match `[T]`.
        timestep: time from one sample to the next [s].
        demonstration: the same for a demonstration, drawn beside it `[S]`.

    Raises:
        ValueError: winners that are not integers `[T]`, or a timestep that is not positive.
    """
    if not timestep > 0:
        raise ValueError(f"expected timestep > 0 [s], got {timestep}")
    panels = {"Winners in recall": integer_series("winners", winners)}
    if demonstration is not None:
        shown = integer_series("winners", demonstration)
        panels = {"Winners in the demonstration": shown} | panels
    row_of = rows_by_first_win(*panels.values())
    figure = new_figure(4.2 * len(panels) + 1, 1.6 + 0.19 * max(len(row_of), 8))
    grid = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (title, series) in zip(grid, panels.items(), strict=True):
        tidy(axes, title, "time [s]", "")
        seconds, won = np.arange(len(series)) * timestep, series >= 0
        rows = [row_of[node] for node in series[won]]
        axes.plot(seconds[won], rows, ".", color=BLUE, markersize=5)
        axes.plot(seconds[~won], np.full((~won).sum(), -1), "x", color=VERMILION, markersize=4)
    unmatched = any((series < 0).any() for series in panels.values())
    labels = ["no match"] * unmatched + [str(node) for node in row_of]
    grid[0].set_yticks(np.arange(len(labels)) - unmatched, labels)
    grid[0].set_ylim(-0.6 - unmatched, max(len(row_of), 1) - 0.4)
    grid[0].set_ylabel("winning node, by first win")
    return figure


def edge_ends(edges: ArrayLike, nodes: int) -> NDArray[np.int64]:
    """Return the two nodes that each edge joins `[E, 2]`, or raise a ValueError."""
    joined = finite_array("edges", edges, ("E", 2)).astype(np.int64)
    if joined.size and (joined.min() < 0 or joined.max() >= nodes):
        raise ValueError(f"expected edges between nodes 0 to {nodes - 1}, got {edges}")
    return joined
