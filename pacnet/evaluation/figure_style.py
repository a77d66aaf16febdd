"""The hand in which all figures are drawn, and checks of the arrays they are drawn from.

Figures are made without pyplot, so they neither open windows nor share state. The colours are those
of Okabe & Ito, told apart by colour-blind readers.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike, NDArray

INK = "#333333"
GREY = "#8c8c8c"
BLUE = "#0072b2"
VERMILION = "#d55e00"
GREEN = "#009e73"
LABEL_SIZE = 8  # [pt]


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inches]."""
    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def tidy(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    """The common style: title, labels, a faint grid, no frame at top and right."""
    axes.set_title(title, fontsize=11, loc="left")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=GREY, alpha=0.25, linewidth=0.6)
    axes.set_axisbelow(True)


def literal(text: str) -> str:
    """A text on one line that matplotlib writes as it stands: no formula between dollar signs."""
    return " ".join(text.split()).replace("$", r"\$")


def component_axes(title: str, variance_ratio: ArrayLike) -> tuple[Figure, Axes]:
    """A figure of two principal components, one scale on both axes so that distances are true."""
    shares = finite_array("variance_ratio", variance_ratio, (None,))
    if len(shares) < 2:
        raise ValueError(f"expected variance_ratio of two or more components, got {len(shares)}")
    labels = [f"principal component {i + 1} ({shares[i]:.0%} of variance)" for i in range(2)]
    figure = new_figure(7, 5.4)
    axes = figure.subplots()
    tidy(axes, title, *labels)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    return figure, axes


def number_places(figure: Figure, axes: Axes, places: NDArray) -> None:
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
        label_place(axes, str(node), places[node], offset, centred=True)
        centres, halves = np.vstack([centres, dot + offset]), np.vstack([halves, half])


def label_place(
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


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """A finite float64 copy of `value`, of that shape (None: any length), or a ValueError."""
    array = np.array(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(
        wanted in (None, size) for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        wanted = ["any" if size is None else size for size in shape]
        raise ValueError(f"expected finite {name} of shape {wanted}, got {array.shape}")
    return array


def winner_series(value: ArrayLike) -> NDArray[np.int64]:
    """Winners as integers [T], or a ValueError."""
    array = np.asarray(value)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(f"expected winners as integers [T], got {array.dtype} {array.shape}")
    return array.astype(np.int64)


def edge_ends(edges: ArrayLike, nodes: int) -> NDArray[np.int64]:
    """The two nodes that each edge joins [E, 2], or a ValueError for a node that is not there."""
    joined = finite_array("edges", edges, (None, 2)).astype(np.int64)
    if joined.size and (joined.min() < 0 or joined.max() >= nodes):
        raise ValueError(f"expected edges between nodes 0 to {nodes - 1}, got {edges}")
    return joined
