"""Figures of Experiment 1: wrist paths (the paper's Figure 7), robustness, novelty thresholds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, PercentFormatter
from numpy.typing import ArrayLike

from pacnet.evaluation.arrays import finite_array
from pacnet.evaluation.figure_style import BLUE, GREY, VERMILION, new_figure, tidy


def wrist_paths(demonstrator: ArrayLike, imitator: ArrayLike) -> Figure:
    """Draw the wrist paths of both from above and from behind (the paper's Figure 7).

    Args:
        demonstrator: Wrist in the demonstrator's body frame, columns depth (forwards), width (to
            the left) and height `[T, 3]` [m].
        imitator: Wrist in the imitator's body frame `[S, 3]` [m].

    Raises:
        ValueError: Paths of another shape, or not finite.
    """
    bold = finite_array("demonstrator", demonstrator, ("T", 3))
    thin = finite_array("imitator", imitator, ("S", 3))
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
        axes.set_aspect("equal", adjustable="datalim")
        axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        axes.invert_xaxis()  # as the robot sees it: its left on the left
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
    """Draw the success rate and the mean wrist distance under each condition.

    Args:
        conditions: Name of each condition `[C]`.
        success_rates: Share of episodes with task success, 0 to 1 `[C]`.
        wrist_distances: Mean distance of the wrists `[C]` [m].

    Raises:
        ValueError: Arrays that are not `[C]`, or not finite.
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
    """Draw nodes and success over the novelty threshold.

    A low threshold over-generalises, a high one over-fits.

    Args:
        thresholds: Activation under which a percept is novel, ascending `[K]`.
        nodes: Nodes of the map learned with each, one or more `[K]`.
        success_rates: Name of a way to recall -> share of episodes with task success with each
            threshold, 0 to 1 `[K]`.
        shipped: The threshold of the shipped checkpoint.

    Raises:
        ValueError: Arrays that are not `[K]`, not finite, or of nodes below one.
    """
    values = finite_array("thresholds", thresholds, ("K",))
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
