"""The paper's figures, and two of ours, each a function from arrays to a matplotlib Figure.

Figures are made without pyplot, so they neither open windows nor share state; save one with
`figure.savefig(path)`. The colours are those of Okabe & Ito, told apart by colour-blind readers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, PercentFormatter
from numpy.typing import ArrayLike, NDArray

INK = "#333333"
GREY = "#8c8c8c"
BLUE = "#0072b2"
VERMILION = "#d55e00"
LABEL_SIZE = 8  # [pt]


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
    points = _array("percepts", percepts, (None, 2))
    seconds = _array("times", times, (len(points),))
    title = f"Percepts on two principal components ({len(points):,} samples)"
    figure, axes = _component_axes(title, variance_ratio)
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
    places = _array("nodes", nodes, (None, 2))
    joined = _array("edges", edges, (None, 2)).astype(int)
    points = _array("percepts", percepts, (None, 2))
    if joined.size and (joined.min() < 0 or joined.max() >= len(places)):
        raise ValueError(f"expected edges between nodes 0 to {len(places) - 1}, got {edges}")
    title = f"Map on two principal components ({len(places)} nodes, {len(joined)} edges)"
    figure, axes = _component_axes(title, variance_ratio)
    axes.scatter(*points.T, color=GREY, alpha=0.25, s=5, linewidths=0, zorder=1)
    axes.add_collection(LineCollection(list(places[joined]), colors=BLUE, linewidths=1.2, zorder=2))
    axes.scatter(*places.T, color=BLUE, edgecolors="white", s=36, zorder=3)
    _number(figure, axes, places)
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
    panels = {"Winners in recall": _winners(winners)}
    if demonstration is not None:
        panels = {"Winners in the demonstration": _winners(demonstration)} | panels
    order = [node for node in dict.fromkeys(np.concatenate([*panels.values()])) if node >= 0]
    row_of = {node: row for row, node in enumerate(order)}
    figure = _figure(4.2 * len(panels) + 1, 1.6 + 0.19 * max(len(order), 8))
    grid = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (title, series) in zip(grid, panels.items(), strict=True):
        _tidy(axes, title, "time [s]", "")
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
    bold = _array("demonstrator", demonstrator, (None, 3))
    thin = _array("imitator", imitator, (None, 3))
    named = {name: _array(name, point, (3,)) for name, point in (marks or {}).items()}
    figure = _figure(9.5, 5.2)
    panels = figure.subplots(1, 2)
    views = (
        ("Wrist paths from above", 0, "depth [m]"),
        ("Wrist paths from behind", 2, "height [m]"),
    )
    for axes, (title, column, label) in zip(panels, views, strict=True):
        _tidy(axes, title, "width, left positive [m]", label)
        axes.plot(bold[:, 1], bold[:, column], color=BLUE, linewidth=4, alpha=0.55)
        axes.plot(thin[:, 1], thin[:, column], color=VERMILION, linewidth=1.2)
        for name, point in named.items():
            axes.plot(point[1], point[column], "+", color=INK, markersize=10, markeredgewidth=2)
            _label(axes, name, (point[1], point[column]), (9, 7))
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
    rates = _array("success_rates", success_rates, (len(conditions),))
    centimetres = 100 * _array("wrist_distances", wrist_distances, (len(conditions),))
    figure = _figure(8.5, 1.4 + 0.38 * len(conditions))
    left, right = figure.subplots(1, 2, sharey=True)
    _tidy(left, "Task success by condition", "success rate", "")
    _tidy(right, "Wrist distance by condition", "mean distance [cm]", "")
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
    values = _array("thresholds", thresholds, (None,))
    counts = _array("nodes", nodes, (len(values),))
    rates = {name: _array(name, rate, (len(values),)) for name, rate in success_rates.items()}
    if (counts < 1).any():
        raise ValueError(f"expected nodes ≥ 1 at each threshold, got {nodes}")
    figure = _figure(7, 4.4)
    left = figure.subplots()
    _tidy(left, "Nodes and task success over the novelty threshold", "novelty threshold", "nodes")
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


def _figure(width: float, height: float) -> Figure:
    """An empty figure [inches]."""
    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def _tidy(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    """The common style: title, labels, a faint grid, no frame at top and right."""
    axes.set_title(title, fontsize=11, loc="left")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=GREY, alpha=0.25, linewidth=0.6)
    axes.set_axisbelow(True)


def _component_axes(title: str, variance_ratio: ArrayLike) -> tuple[Figure, Axes]:
    """A figure of two principal components, one scale on both axes so that distances are true."""
    shares = _array("variance_ratio", variance_ratio, (None,))
    if len(shares) < 2:
        raise ValueError(f"expected variance_ratio of two or more components, got {len(shares)}")
    labels = [f"principal component {i + 1} ({shares[i]:.0%} of variance)" for i in range(2)]
    figure = _figure(7, 5.4)
    axes = figure.subplots()
    _tidy(axes, title, *labels)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    return figure, axes


def _number(figure: Figure, axes: Axes, places: NDArray) -> None:
    """Write each node's number beside it, where it covers the fewest numbers and nodes."""
    figure.draw_without_rendering()  # the layout settles the scale
    dots = axes.transData.transform(places) * 72 / figure.dpi  # [N, 2] [pt]
    turns = np.radians(np.arange(45, 405, 45))
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    offsets = np.concatenate([radius * circle for radius in (9, 14, 20, 27)])  # [32, 2] [pt]
    centres, halves = dots, np.full_like(dots, 4)  # boxes that are taken
    for node, dot in enumerate(dots):
        half = np.array([0.33 * LABEL_SIZE * len(str(node)) + 1, 0.5 * LABEL_SIZE])
        gaps = np.abs((dot + offsets)[:, None] - centres) - halves - half  # [32, M, 2]
        offset = offsets[(gaps < 0).all(axis=2).sum(axis=1).argmin()]
        _label(axes, str(node), places[node], offset, centred=True)
        centres, halves = np.vstack([centres, dot + offset]), np.vstack([halves, half])


def _label(
    axes: Axes, text: str, place: ArrayLike, offset: ArrayLike, centred: bool = False
) -> None:
    """Write a text at an offset [pt] from a place in data units, joined to it if far away."""
    (x, y), (right, up) = np.asarray(place), np.asarray(offset)
    axes.annotate(
        text,
        (x, y),
        (right, up),
        textcoords="offset points",
        ha="center" if centred else "left",
        va="center",
        size=LABEL_SIZE,
        color=INK,
        path_effects=[withStroke(linewidth=2, foreground="white")],
        arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.6}
        if np.hypot(right, up) > 12
        else None,
        in_layout=False,
    )


def _array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """A finite float64 copy of `value`, of that shape (None: any length), or a ValueError."""
    array = np.array(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(
        wanted in (None, size) for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        wanted = ["any" if size is None else size for size in shape]
        raise ValueError(f"expected finite {name} of shape {wanted}, got {array.shape}")
    return array


def _winners(value: ArrayLike) -> NDArray[np.int64]:
    """Winners as integers [T], or a ValueError."""
    array = np.asarray(value)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(f"expected winners as integers [T], got {array.dtype} {array.shape}")
    return array.astype(np.int64)
