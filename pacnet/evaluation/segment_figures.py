"""The figure of where an episode is cut: how near the moved point is to each landmark over time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import blended_transform_factory
from numpy.typing import NDArray

from pacnet.evaluation.figure_style import COLOURS, GREY, INK, LABEL_SIZE, new_figure, tidy, wrapped
from pacnet.imitator.cuts import Approach

_TITLE_WIDTH = 80  # [characters]
_HEADROOM = 1.18  # of the axes, for the names of stretches
_LETTER = 0.009  # width of a letter, as a share of the axes' width
_THIN = 0.8  # [pt]
_STYLES = ("-", "--", ":", "-.")  # of lines, from the seventh landmark on
_NOWHERE = "no landmark"


def distances_over_time(
    approach: Approach, names: Sequence[str], timestep: float, title: str
) -> Figure:
    """Draw the moved point's distance from each landmark, and which one it is on its way to.

    Stretches have the colour and the name of that landmark. A line is thin while its landmark
    is carried or pushed, which is no place to go to then.

    Args:
        approach: of an episode's T frames.
        names: of the moved point, then of the M landmarks.
        timestep: time from one frame to the next [s].
        title: of the figure.

    Raises:
        ValueError: not one name for each point, or a timestep that is not positive.
    """
    distances, landmark, carried = approach
    if len(names) != 1 + distances.shape[1]:
        raise ValueError(f"expected names of {1 + distances.shape[1]} points, got {list(names)}")
    if not timestep > 0:
        raise ValueError(f"expected timestep > 0 [s], got {timestep}")
    figure = new_figure(8.5, 3.6)
    figure.suptitle(wrapped(title, _TITLE_WIDTH), x=0.01, ha="left", fontsize=12)
    axes = figure.subplots()
    what = f"Distance of {names[0]} from each landmark, and which one it is on its way to"
    tidy(axes, what, "time [s]", "distance")
    for number in range(distances.shape[1]):
        _draw_line(axes, timestep, distances[:, number], carried[:, number], number)
    axes.set_ylim(0, _HEADROOM * float(distances.max()) or 1)
    axes.set_xlim(0, timestep * len(distances))
    _draw_segments(axes, timestep, landmark, names[1:])
    handles = _legend(names[1:], bool(carried.any()))
    columns = min(4, len(handles))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _legend(landmarks: Sequence[str], shows_carried: bool) -> list[Line2D]:
    lines = [
        Line2D([], [], color=_colour(number), linestyle=_style(number), linewidth=2, label=name)
        for number, name in enumerate(landmarks)
    ]
    if shows_carried:
        lines.append(
            Line2D([], [], color=INK, linewidth=_THIN, label="thin: the landmark is carried")
        )
    return lines


def _draw_line(
    axes: Axes, timestep: float, distance: NDArray, carried: NDArray, number: int
) -> None:
    """Draw the distance from one landmark, thin while that is carried."""
    seconds = timestep * np.arange(len(distance))
    style: dict[str, Any] = {"color": _colour(number), "linestyle": _style(number)}
    marker = "." if len(distance) == 1 else None  # a line needs two
    axes.plot(seconds, distance, linewidth=_THIN, marker=marker, **style)
    at_rest = np.where(carried, np.nan, distance)
    axes.plot(seconds, at_rest, linewidth=2, **style)  # over the thin one


def _draw_segments(axes: Axes, timestep: float, landmark: NDArray, names: Sequence[str]) -> None:
    """Shade each stretch, and write the landmark's name above it where there is room."""
    cuts = (np.flatnonzero(np.diff(landmark)) + 1).tolist()
    across = blended_transform_factory(axes.transData, axes.transAxes)
    for first, end in pairwise([0, *cuts, len(landmark)]):
        number = int(landmark[first])
        colour, name = (GREY, _NOWHERE) if number < 0 else (_colour(number), names[number])
        axes.axvspan(timestep * first, timestep * end, color=colour, alpha=0.13, linewidth=0)
        if (end - first) / len(landmark) > _LETTER * len(name):
            axes.text(
                timestep * (first + end) / 2, 0.97, name, transform=across,
                ha="center", va="top", size=LABEL_SIZE, color=INK,
            )  # fmt: skip
    for cut in cuts:
        axes.axvline(timestep * cut, color=INK, linewidth=_THIN)


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _style(number: int) -> Any:
    return _STYLES[number // len(COLOURS) % len(_STYLES)]
