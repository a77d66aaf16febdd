"""The paper's figures, and two of ours, each a function from arrays to a matplotlib Figure.

Figures are made without pyplot, so they neither open windows nor share state; save one with
`figure.savefig(path)`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, PercentFormatter
from numpy.typing import ArrayLike

from pacnet.evaluation.figure_style import (
    BLUE,
    GREY,
    INK,
    VERMILION,
    component_axes,
    edge_ends,
    finite_array,
    label_place,
    new_figure,
    number_places,
    tidy,
    winner_series,
)


def percepts_on_components(
    percepts: ArrayLike, times: ArrayLike, variance_ratio: ArrayLike
) -> Figure:
    """Percepts on their two principal components, coloured by time (the paper's Figures 6a, 9a).

    Args:
        percepts: Projected percepts [T, 2].
        times: Time of each within its episode [T] [s].
        variance_ratio: Share of the variance on each component, two or more.

    Raises:
        ValueError: Arrays of other shapes, or not finite.
    """
    points = finite_array("percepts", percepts, (None, 2))
    seconds = finite_array("times", times, (len(points),))
    title = f"Percepts on two principal components ({len(points):,} samples)"
    figure, axes = component_axes(title, variance_ratio)
    dots = axes.scatter(*points.T, c=seconds, cmap="viridis", s=7, linewidths=0)
    figure.colorbar(dots, ax=axes, label="time in episode [s]", pad=0.02)
    return figure


def map_on_components(
    nodes: ArrayLike, edges: ArrayLike, percepts: ArrayLike, variance_ratio: ArrayLike
) -> Figure:
    """The map on the percepts' two principal components (the paper's Figures 6b, 9b).

    Args:
        nodes: Projected nodes [N, 2], numbered by their row; N may be 0.
        edges: The two nodes that each edge joins [E, 2].
        percepts: Projected percepts, drawn faintly behind [T, 2].
        variance_ratio: Share of the variance on each component, two or more.

    Raises:
        ValueError: Arrays of other shapes, not finite, or an edge to a node that is not there.
    """
    places = finite_array("nodes", nodes, (None, 2))
    joined = edge_ends(edges, len(places))
    points = finite_array("percepts", percepts, (None, 2))
    title = f"Map on two principal components ({len(places)} nodes, {len(joined)} edges)"
    figure, axes = component_axes(title, variance_ratio)
    axes.scatter(*points.T, color=GREY, alpha=0.25, s=5, linewidths=0, zorder=1)
    axes.add_collection(LineCollection(list(places[joined]), colors=BLUE, linewidths=1.2, zorder=2))
    axes.scatter(*places.T, color=BLUE, edgecolors="white", s=36, zorder=3)
    number_places(figure, axes, places)
    return figure


def winners_over_time(
    winners: ArrayLike, timestep: float, demonstration: ArrayLike | None = None
) -> Figure:
    """Winning node at each sample (the paper's Figures 6c, 9c).

    A row a node, in the order in which they first win (in the demonstration, if there is one), so
    that an action with a sequence climbs like a staircase.

    Args:
        winners: Node that wins each sample, negative for no match [T].
        timestep: Time from one sample to the next [s].
        demonstration: The same for a demonstration, drawn beside it [S].

    Raises:
        ValueError: Winners that are not integers [T], or a timestep that is not positive.
    """
    if not timestep > 0:
        raise ValueError(f"expected timestep > 0 [s], got {timestep}")
    panels = {"Winners in recall": winner_series(winners)}
    if demonstration is not None:
        panels = {"Winners in the demonstration": winner_series(demonstration)} | panels
    order = [node for node in dict.fromkeys(np.concatenate([*panels.values()])) if node >= 0]
    row_of = {node: row for row, node in enumerate(order)}
    figure = new_figure(4.2 * len(panels) + 1, 1.6 + 0.19 * max(len(order), 8))
    grid = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (title, series) in zip(grid, panels.items(), strict=True):
        tidy(axes, title, "time [s]", "")
        seconds, won = np.arange(len(series)) * timestep, series >= 0
        rows = [row_of[node] for node in series[won]]
        axes.plot(seconds[won], rows, ".", color=BLUE, markersize=5)
        axes.plot(seconds[~won], np.full((~won).sum(), -1), "x", color=VERMILION, markersize=4)
    unmatched = any((series < 0).any() for series in panels.values())
    labels = ["no match"] * unmatched + [str(node) for node in order]
    grid[0].set_yticks(np.arange(len(labels)) - unmatched, labels)
    grid[0].set_ylim(-0.6 - unmatched, max(len(order), 1) - 0.4)
    grid[0].set_ylabel("winning node, by first win")
    return figure


def wrist_paths(
    demonstrator: ArrayLike, imitator: ArrayLike, marks: Mapping[str, ArrayLike] | None = None
) -> Figure:
    """Wrist paths of demonstrator and imitator from above and behind (the paper's Figure 7).

    Args:
        demonstrator: Wrist in the demonstrator's body frame, columns depth (forwards), width (to
            the left) and height [T, 3] [m].
        imitator: Wrist in the imitator's body frame [S, 3] [m].
        marks: Named points of that frame to mark, such as the mouth and the glass, each [3] [m].

    Raises:
        ValueError: Paths or marks of another shape, or not finite.
    """
    bold = finite_array("demonstrator", demonstrator, (None, 3))
    thin = finite_array("imitator", imitator, (None, 3))
    named = {name: finite_array(name, point, (3,)) for name, point in (marks or {}).items()}
    figure = new_figure(9.5, 5.2)
    panels = figure.subplots(1, 2)
    views = (
        ("Wrist paths from above", 0, "depth [m]"),
        ("Wrist paths from behind", 2, "height [m]"),
    )
    for axes, (title, column, label) in zip(panels, views, strict=True):
        tidy(axes, title, "width, left positive [m]", label)
        axes.plot(bold[:, 1], bold[:, column], color=BLUE, linewidth=4, alpha=0.55)
        axes.plot(thin[:, 1], thin[:, column], color=VERMILION, linewidth=1.2)
        for name, point in named.items():
            axes.plot(point[1], point[column], "+", color=INK, markersize=10, markeredgewidth=2)
            label_place(axes, name, (point[1], point[column]), (9, 7))
        axes.set_aspect("equal", adjustable="datalim")
        axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        axes.invert_xaxis()  # seen with the robot's eyes, its left is on the left
    figure.legend(
        panels[0].lines[:2],
        ("demonstrator", "imitator"),
        loc="outside lower center",
        ncols=2,
        frameon=False,
    )
    return figure


def robustness(
    conditions: Sequence[str], success_rates: ArrayLike, wrist_distances: ArrayLike
) -> Figure:
    """Success rate and mean wrist distance under each condition.

    Args:
        conditions: Name of each condition [C].
        success_rates: Share of episodes with task success, 0 to 1 [C].
        wrist_distances: Mean distance of the wrists [C] [m].

    Raises:
        ValueError: Arrays that are not [C], or not finite.
    """
    rates = finite_array("success_rates", success_rates, (len(conditions),))
    centimetres = 100 * finite_array("wrist_distances", wrist_distances, (len(conditions),))
    figure = new_figure(8.5, 1.4 + 0.38 * len(conditions))
    left, right = figure.subplots(1, 2, sharey=True)
    tidy(left, "Task success by condition", "success rate", "")
    tidy(right, "Wrist distance by condition", "mean distance [cm]", "")
    rows = np.arange(len(conditions))
    left.bar_label(left.barh(rows, rates, 0.6, color=BLUE), fmt="{:.0%}", padding=3)
    right.bar_label(right.barh(rows, centimetres, 0.6, color=VERMILION), fmt="{:.1f}", padding=3)
    left.set_xlim(0, 1.15)
    left.set_xticks(np.linspace(0, 1, 5))
    left.xaxis.set_major_formatter(PercentFormatter(1))
    right.set_xlim(0, 1.15 * max(centimetres.max(initial=0), 1e-9))
    left.set_yticks(rows, conditions)
    left.invert_yaxis()  # the first condition on top
    for axes in (left, right):
        axes.grid(visible=False, axis="y")
    return figure


def threshold_sweep(
    thresholds: ArrayLike, nodes: ArrayLike, success_rates: Mapping[str, ArrayLike], shipped: float
) -> Figure:
    """Nodes and success over the novelty threshold: over-generalisation against over-fitting.

    Args:
        thresholds: Activation under which a percept is novel, ascending [K].
        nodes: Nodes of the map learned with each, one or more [K].
        success_rates: Name of a way to recall -> share of episodes with task success with each
            threshold, 0 to 1 [K].
        shipped: The threshold of the shipped checkpoint.

    Raises:
        ValueError: Arrays that are not [K], not finite, or of nodes below one.
    """
    values = finite_array("thresholds", thresholds, (None,))
    counts = finite_array("nodes", nodes, (len(values),))
    rates = {name: finite_array(name, rate, (len(values),)) for name, rate in success_rates.items()}
    if (counts < 1).any():
        raise ValueError(f"expected nodes ≥ 1 at each threshold, got {nodes}")
    figure = new_figure(7, 4.4)
    left = figure.subplots()
    tidy(left, "Nodes and task success over the novelty threshold", "novelty threshold", "nodes")
    right = left.twinx()
    right.spines[["top", "left"]].set_visible(False)
    (line,) = left.plot(values, counts, "o-", color=BLUE)
    others = [
        right.plot(values, rate, style, color=VERMILION)[0]
        for rate, style in zip(rates.values(), ("s--", "^:", "v-."), strict=False)
    ]
    mark = left.axvline(shipped, color=GREY, linewidth=5, alpha=0.4, zorder=0)
    left.set_yscale("log")
    left.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    left.yaxis.set_major_formatter("{x:g}")
    left.yaxis.set_minor_formatter(NullFormatter())
    right.set_ylim(-0.03, 1.05)
    right.yaxis.set_major_formatter(PercentFormatter(1))
    right.set_ylabel("success rate")
    for axes, colour in ((left, BLUE), (right, VERMILION)):
        axes.yaxis.label.set_color(colour)
        axes.tick_params(axis="y", colors=colour)
    names = ("nodes", f"shipped threshold {shipped:g}", *(f"success, {name}" for name in rates))
    drawn = (line, mark, *others)
    figure.legend(drawn, names, loc="outside lower center", ncols=2, frameon=False)
    return figure
