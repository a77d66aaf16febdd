"""A figure of how well a body is known after so many postures."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from pacnet.evaluation.figure_style import COLOURS, new_figure, tidy
from train.postural.babbling.scores import Score


def error_curves(scores: Mapping[int, Mapping[str, Score]]) -> Figure:
    """Draw the error of the grip's place over the number of postures, for each way to learn.

    Args:
        scores: Of each number of postures, by the way.
    """
    figure = new_figure(7, 4)
    axes = figure.subplots()
    tidy(axes, "Where the hand is, in postures that were not tried", "postures tried", "RMS [mm]")
    ways = next(iter(scores.values()))
    for way, colour in zip(ways, COLOURS, strict=False):
        errors = [of_count[way].place_rms_mm for of_count in scores.values()]
        axes.plot(list(scores), errors, "o-", color=colour, label=way, markersize=4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(list(scores), [str(count) for count in scores], minor=False)
    axes.minorticks_off()
    ticks = (1, 2, 3, 5, 10, 20, 30, 50, 100)
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.legend(frameon=False, fontsize=8)
    return figure
