"""The common style of all figures.

Figures are made without pyplot, so they neither open windows nor share state. The colours are those
of Okabe & Ito, which colour-blind readers can tell apart.
"""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.arrays import finite_array

INK = "#333333"
GREY = "#8c8c8c"
BLUE = "#0072b2"
VERMILION = "#d55e00"
GREEN = "#009e73"
COLOURS = (BLUE, VERMILION, GREEN, "#cc79a7", "#56b4e9", "#e69f00")  # the lightest last
LABEL_SIZE = 8  # [pt]


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a width and height [inches]."""
    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def tidy(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    """Set title, labels and a faint grid; remove the frame at the top and on the right."""
    axes.set_title(title, fontsize=11, loc="left")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=GREY, alpha=0.25, linewidth=0.6)
    axes.set_axisbelow(True)


def wrapped(text: str, width: int) -> str:
    """Return a text on at most three lines, without formulas between dollar signs."""
    plain = " ".join(text.split()).replace("$", r"\$")
    return "\n".join(textwrap.wrap(plain, width, max_lines=3, placeholder=" …"))


def component_axes(title: str, variance_ratio: ArrayLike) -> tuple[Figure, Axes]:
    """Return a figure of two principal components, with one scale on both axes.

    Args:
        title: of the figure.
        variance_ratio: share of the variance on each component, two or more.

    Raises:
        ValueError: fewer than two shares, or not finite.
    """
    shares = finite_array("variance_ratio", variance_ratio, ("D",))
    if len(shares) < 2:
        raise ValueError(f"expected variance_ratio of two or more components, got {len(shares)}")
    labels = [f"principal component {i + 1} ({shares[i]:.0%} of variance)" for i in range(2)]
    figure = new_figure(7, 5.4)
    axes = figure.subplots()
    tidy(axes, title, *labels)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    return figure, axes


def number_nodes(figure: Figure, axes: Axes, nodes: NDArray) -> None:
    """Write each node's number beside its point `[N, 2]`, where it covers the fewest others."""
    figure.draw_without_rendering()  # only now are the axes scaled
    dots = axes.transData.transform(nodes) * 72 / figure.dpi  # [N, 2] [pt]
    turns = np.radians(np.arange(45, 405, 45))
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    offsets = np.concatenate([radius * circle for radius in (9, 14, 20, 27)])  # [32, 2] [pt]
    centres, halves = dots, np.full_like(dots, 4)  # boxes that are taken
    for node, dot in enumerate(dots):
        half = np.array([0.33 * LABEL_SIZE * len(str(node)) + 1, 0.5 * LABEL_SIZE])
        gaps = np.abs((dot + offsets)[:, None] - centres) - halves - half  # [32, M, 2]
        offset = offsets[(gaps < 0).all(axis=2).sum(axis=1).argmin()]
        label_point(axes, str(node), nodes[node], offset, centred=True)
        centres, halves = np.vstack([centres, dot + offset]), np.vstack([halves, half])


def label_point(
    axes: Axes, text: str, point: ArrayLike, offset: ArrayLike, centred: bool = False
) -> None:
    """Write a text at an offset [pt] from a point in data units, with a line to it if far away."""
    (x, y), (right, up) = np.asarray(point), np.asarray(offset)
    far = np.hypot(right, up) > 12
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
        arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.6} if far else None,
        in_layout=False,
    )


def rows_by_first_win(*winners: NDArray[np.int64]) -> dict[int, int]:
    """Return node -> row, in the order in which the nodes first win; negative winners are none."""
    nodes = dict.fromkeys(int(node) for series in winners for node in series if node >= 0)
    return {node: row for row, node in enumerate(nodes)}
