"""The novelty of known and new situations to an imitator, over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from pacnet.evaluation.figure_style import COLOURS, GREY, new_figure, tidy
from train.postural.correction.episodes import Attempt


def novelty_over_time(attempts: Mapping[str, Attempt], timestep: float) -> Figure:
    """Draw the novelty of episodes, with the pause and the contact with the glass marked.

    Args:
        attempts: Name -> episode, up to six of them.
        timestep: Time from one step to the next [s].
    """
    figure = new_figure(7.5, 3.8)
    axes = figure.subplots()
    tidy(axes, "Novelty of percepts", "time [s]", "novelty, in tolerances")
    for (name, attempt), colour in zip(attempts.items(), COLOURS, strict=False):
        times = timestep * np.arange(len(attempt.novelty))
        axes.plot(times, attempt.novelty, color=colour, linewidth=1.2, label=name)
        if attempt.pause is not None:
            at = attempt.pause.step
            axes.plot(times[at], attempt.novelty[at], "o", color=colour)
            axes.annotate(
                f"pauses: {attempt.pause.dimension}",
                (times[at], attempt.novelty[at]),
                (10, 8),
                textcoords="offset points",
                va="center",
                color=colour,
            )
        if attempt.contact is not None:
            axes.axvline(
                times[attempt.contact],
                color=colour,
                linestyle=":",
                label="imitator's hand at its glass",
            )
    grasps = [attempt.grasp for attempt in attempts.values() if attempt.grasp is not None]
    if grasps:
        at, label = timestep * max(grasps), "demonstrator's hand at its glass"
        axes.axvline(at, color=GREY, linestyle="--", label=label)
    axes.axhline(1, color=GREY, linewidth=1, label="novel above")
    axes.set_ylim(bottom=0)
    figure.legend(frameon=False, fontsize=9, loc="outside lower center", ncols=3)
    return figure
