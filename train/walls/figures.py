"""The figures of Experiment 2: the paper's Figures 9b and 9c, and others.

Left walls are blue and right walls vermilion in all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.ticker import StrMethodFormatter
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.arrays import finite_array, integer_series
from pacnet.evaluation.figure_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    LABEL_SIZE,
    VERMILION,
    component_axes,
    label_point,
    new_figure,
    number_nodes,
    tidy,
)
from pacnet.evaluation.map_figures import edge_ends
from train.walls.scores import LEFT, NO_WALL, RIGHT, SIDES

COLOURS = {LEFT: BLUE, NO_WALL: GREY, RIGHT: VERMILION}  # of clusters, top to bottom
SCORES = {"wf": "wf: 8–50 mm from a wall", "tight": "tight: 18–34 mm from a wall"}

NUMBERED_NODES = 40  # maps of more nodes have no numbers


def clusters_on_components(
    nodes: ArrayLike,
    edges: ArrayLike,
    percepts: ArrayLike,
    names: Sequence[str],
    variance_ratio: ArrayLike,
) -> Figure:
    """Draw the map on the percepts' two principal components, by cluster (Figure 9b).

    Nodes carry their numbers unless there are more than 40.

    Args:
        nodes: Projected nodes `[N, 2]`, numbered by their row.
        edges: The two nodes that each edge joins `[E, 2]`.
        percepts: Projected percepts, drawn faintly behind `[T, 2]`.
        names: Cluster of each node: "left", "no wall" or "right" `[N]`.
        variance_ratio: Share of the variance on each component, two or more.

    Raises:
        ValueError: Arrays of other shapes, not finite, an edge to a node that does not exist, or an
            unknown name.
    """
    places = finite_array("nodes", nodes, ("N", 2))
    joined = edge_ends(edges, len(places))
    points = finite_array("percepts", percepts, ("T", 2))
    clusters = _clusters(names, len(places))
    title = f"Clusters of the map ({len(places)} nodes, {len(joined)} edges)"
    figure, axes = component_axes(title, variance_ratio)
    axes.scatter(*points.T, color=GREY, alpha=0.2, s=4, linewidths=0, zorder=1, rasterized=True)
    axes.add_collection(LineCollection(list(places[joined]), colors=INK, linewidths=1, zorder=2))
    for name, colour in COLOURS.items():
        own = places[clusters == name]
        label = f"{name} ({len(own)} node{'s' * (len(own) != 1)})"
        axes.scatter(*own.T, color=colour, edgecolors="white", s=46, zorder=3, label=label)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    if len(places) <= NUMBERED_NODES:
        number_nodes(figure, axes, places)
    return figure


def activations_over_time(winners: ArrayLike, names: Sequence[str], timestep: float) -> Figure:
    """Draw the winning node at each step, grouped by cluster (Figure 9c).

    Each node has a row: left walls on top, right walls below, steps without a winner at the bottom.

    Args:
        winners: Node that wins each step, negative for no match `[T]`.
        names: Cluster of each node: "left", "no wall" or "right" `[N]`.
        timestep: Time from one step to the next [s].

    Raises:
        ValueError: Winners that are not integers `[T]` below N, an unknown name, or a timestep that
            is not positive.
    """
    series, clusters = integer_series("winners", winners), _clusters(names, len(names))
    if not timestep > 0:
        raise ValueError(f"expected timestep > 0 [s], got {timestep}")
    if series.max(initial=-1) >= len(clusters):
        raise ValueError(f"expected winners below {len(clusters)} nodes, got {series.max()}")
    groups = {name: np.flatnonzero(clusters == name) for name in COLOURS}
    order = np.concatenate(list(groups.values()))
    row_of = np.argsort(order)
    unmatched = bool((series < 0).any())
    height = min(0.17, 6 / max(len(order), 1)) * 72  # of a row [pt]
    figure = new_figure(9.5, 1.4 + max(len(order) + unmatched, 6) * height / 72)
    axes = figure.subplots()
    title = f"Winners in recall ({len(series):,} steps, {len(series) * timestep / 60:.3g} min)"
    tidy(axes, title, f"step of {timestep:g} s", "winning node")
    steps = np.arange(len(series))
    ticks = {"markersize": 0.8 * height, "markeredgewidth": 0.6, "rasterized": True}
    for name, group in groups.items():
        won = np.isin(series, group)
        axes.plot(steps[won], row_of[series[won]], "|", color=COLOURS[name], **ticks)
    none = steps[series < 0]
    axes.plot(none, np.full(len(none), len(order)), "|", color=INK, **ticks)
    _name_rows(axes, groups, unmatched)
    return figure


def trajectory(
    walls: Sequence[ArrayLike], poses: ArrayLike, wall_side: ArrayLike, commanded: ArrayLike
) -> Figure:
    """Draw a run on the arena from above, coloured by what drove each step.

    Grey for the default behaviour; for recall, a colour for the side of the wall.

    Args:
        walls: Outline of each wall, closed by itself, each `[P, 2]` [m].
        poses: x, y and heading after each step `[T, 3]` [m, m, rad].
        wall_side: Where the nearest wall is: 1 left, -1 right, 0 none near `[T]`.
        commanded: Whether the network commanded the step `[T]`.

    Raises:
        ValueError: Arrays of other shapes, not finite, empty, or sides other than -1, 0 and 1.
    """
    places = finite_array("poses", poses, ("T", 3))[:, :2]
    sides = finite_array("wall_side", wall_side, (len(places),))
    recalled = finite_array("commanded", np.asarray(commanded, int), (len(places),)) != 0
    outlines = [finite_array("walls", wall, ("P", 2)) for wall in walls]
    if not len(places) or not np.isin(sides, list(SIDES.values())).all():
        raise ValueError(f"expected one or more steps with sides -1, 0 or 1, got {sides}")
    kinds = {
        "default behaviour": (GREY, ~recalled),
        "recalled, no wall near": (GREEN, recalled & (sides == SIDES[NO_WALL])),
        "recalled, wall on the left": (BLUE, recalled & (sides == SIDES[LEFT])),
        "recalled, wall on the right": (VERMILION, recalled & (sides == SIDES[RIGHT])),
    }
    extent = np.ptp(np.concatenate([places, *outlines]), axis=0)  # [m]
    figure = new_figure(7, 1.7 + 6.2 * np.clip(extent[1] / max(extent[0], 1e-9), 0.2, 1.3))
    axes = figure.subplots()
    tidy(axes, f"Path of the robot ({len(places):,} steps)", "x [m]", "y [m]")
    for outline in outlines:
        axes.add_patch(Polygon(outline, closed=True, facecolor=INK, edgecolor=INK, linewidth=0.5))
    moves = np.stack([places[:-1], places[1:]], axis=1)  # [T - 1, 2, 2], into the second step on
    for label, (colour, steps) in kinds.items():
        lines = list(moves[steps[1:]])
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=1.1, label=label))
    for name, marker, size, place in (("start", "o", 11, places[0]), ("end", "s", 6, places[-1])):
        (mark,) = axes.plot(*place, marker, color="white", markersize=size, label=name)
        mark.set_markeredgecolor(INK)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.03)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=LABEL_SIZE + 1)
    return figure


def conditions(
    table: Mapping[str, Mapping[str, tuple[float, float]]],
    wanted: Mapping[str, Mapping[str, float]] | None = None,
) -> Figure:
    """Draw wf and tight under each condition, with whiskers of one standard deviation.

    Args:
        table: Condition -> score -> mean and standard deviation over replicates.
        wanted: Condition -> score -> least mean wanted, drawn across that condition's bar.

    Raises:
        ValueError: No conditions, one without both scores, numbers that are not finite, or a
            wanted condition that is not in the table.
    """
    goals = wanted or {}
    if not table or any(set(SCORES) - set(scores) for scores in table.values()):
        raise ValueError(f"expected conditions with {list(SCORES)} each, got {table}")
    if set(goals) - set(table):
        raise ValueError(f"expected wanted conditions out of {list(table)}, got {list(goals)}")
    figure = new_figure(9.5, 1.4 + 0.38 * len(table))
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, (score, title), colour in zip(panels, SCORES.items(), (BLUE, GREEN), strict=True):
        values = finite_array(score, [scores[score] for scores in table.values()], ("C", 2))
        tidy(axes, title, "mean ± std", "")
        _draw_bars(axes, values, colour)
        least = np.array([goals.get(name, {}).get(score, np.nan) for name in table])
        rows = np.flatnonzero(np.isfinite(least))
        axes.vlines(least[rows], rows - 0.4, rows + 0.4, color=INK)
        axes.grid(visible=False, axis="y")
    panels[0].set_yticks(np.arange(len(table)), list(table))
    panels[0].invert_yaxis()  # the first condition on top
    if goals:
        mark = Line2D([], [], color=INK, marker="|", linestyle="none", markersize=12)
        figure.legend([mark], ["wanted at least"], loc="outside lower center", frameon=False)
    return figure


def _clusters(names: Sequence[str], nodes: int) -> NDArray[np.str_]:
    """Return the cluster of each node `[N]`, or raise a ValueError."""
    if len(names) != nodes or set(names) - set(COLOURS):
        raise ValueError(f"expected {nodes} names out of {list(COLOURS)}, got {list(names)}")
    return np.array(names, dtype=str)


def _name_rows(axes: Axes, groups: Mapping[str, NDArray[np.int64]], unmatched: bool) -> None:
    """Number the rows, name the clusters beside them, and separate these by lines."""
    labels = [str(node) for group in groups.values() for node in group]
    top = 0
    for name, group in groups.items():
        if len(group):
            middle, colour = top + (len(group) - 1) / 2, COLOURS[name]
            axes.text(
                1.01, middle, name, color=colour, va="center", transform=axes.get_yaxis_transform()
            )
            axes.axhline(top - 0.5, color=GREY, linewidth=0.8)
        top += len(group)
    labels += ["no match"] * unmatched
    axes.set_yticks(np.arange(len(labels)), labels, size=LABEL_SIZE - 2)
    axes.set_ylim(max(len(labels), 1) - 0.4, -0.6)
    if unmatched:
        axes.axhline(top - 0.5, color=GREY, linewidth=0.8)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.01)
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))


def _draw_bars(axes: Axes, values: NDArray[np.float64], colour: str) -> None:
    """Draw a bar, a whisker and their numbers for each mean and standard deviation `[C, 2]`."""
    means, stds = values.T
    rows = np.arange(len(values))
    axes.barh(rows, means, 0.6, xerr=stds, color=colour, error_kw={"ecolor": INK, "capsize": 2})
    for row, (mean, std) in enumerate(values):
        label_point(axes, f"{mean:.2f} ± {std:.2f}", (mean + std, row), (6, 0))
    axes.set_xlim(0, max(1.25, (means + stds).max() + 0.35))  # with room for the numbers
    axes.set_xticks(np.linspace(0, 1, 6))
