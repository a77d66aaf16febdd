"""Figures of several behaviours: when the shown one is recognized, and how novel a new one is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.figure_style import BLUE, GREEN, GREY, VERMILION, new_figure, tidy

_COLOURS = (BLUE, VERMILION, GREEN)
_BEFORE, _AFTER = 2.5, 2.5  # [s] drawn before and after the behaviours diverge


def naming(
    probabilities: Mapping[str, Sequence[NDArray]],
    partings: Mapping[str, Sequence[int]],
    deadlines: Sequence[float],
    timestep: float,
) -> Figure:
    """Draw the probability of the shown behaviour around the sample where behaviours diverge.

    Args:
        probabilities: Behaviour -> for each episode, its probability at each sample `[T]`.
        partings: Behaviour -> for each episode, the sample at which the behaviours diverge.
        deadlines: A tenth of the duration of each episode [s].
        timestep: Time from one sample to the next [s].
    """
    figure = new_figure(7.5, 3.8)
    axes = figure.subplots()
    tidy(axes, "Which behaviour is it?", "time after the behaviours part [s]",
         "probability of the one shown")  # fmt: skip
    offsets = np.arange(-round(_BEFORE / timestep), round(_AFTER / timestep) + 1)
    for (behaviour, episodes), colour in zip(probabilities.items(), _COLOURS, strict=False):
        around = np.stack(
            [
                episode[np.clip(offsets + parting, 0, len(episode) - 1)]
                for episode, parting in zip(episodes, partings[behaviour], strict=True)
            ]
        )
        low, middle, high = np.quantile(around, (0.05, 0.5, 0.95), axis=0)
        axes.fill_between(offsets * timestep, low, high, color=colour, alpha=0.2, linewidth=0)
        label = f"{behaviour}: median and 5–95 % of {len(episodes)} episodes"
        axes.plot(offsets * timestep, middle, color=colour, label=label)
    axes.axvline(0, color=GREY, linewidth=1)
    axes.axvline(
        float(np.mean(deadlines)), color=GREY, linewidth=1, linestyle="--",
        label="a tenth of an episode later",
    )  # fmt: skip
    axes.set_ylim(-0.02, 1.02)
    axes.legend(loc="lower right", frameon=False, fontsize=9)
    return figure


def novelty(known: ArrayLike, new: ArrayLike, threshold: float, names: tuple[str, str]) -> Figure:
    """Draw the distribution of the novelty of single percepts.

    Args:
        known: Novelty of percepts of taught behaviours `[N]`.
        new: Novelty of percepts of other behaviours `[M]`.
        threshold: Above which a percept is novel.
        names: Of both, for the legend.
    """
    figure = new_figure(7.5, 3.4)
    axes = figure.subplots()
    tidy(axes, "Novelty of single percepts after the approach", "novelty", "share of percepts")
    edges = np.linspace(0, 1, 61)
    for values, name, colour in zip((known, new), names, (BLUE, VERMILION), strict=True):
        values = np.asarray(values)
        weights = np.full(len(values), 1 / len(values))
        axes.hist(values, edges, weights=weights, color=colour, alpha=0.6, label=name)
    axes.axvline(threshold, color=GREY, linestyle="--", label="novel above")
    axes.legend(frameon=False, fontsize=9)
    return figure
