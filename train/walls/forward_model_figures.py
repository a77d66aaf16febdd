"""Figures of a fitted forward model: its losses and its calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.arrays import finite_array
from pacnet.evaluation.figure_style import BLUE, GREY, VERMILION, new_figure, tidy

CALIBRATION_BINS = 15
BIN_SAMPLES = 10  # fewest for a mean and a spread


def calibration(predicted: ArrayLike, true: ArrayLike, names: Sequence[str]) -> Figure:
    """Draw true against predicted change of each sensor: means and spread in bins.

    Bins of one width span the predicted changes; those of fewer than 10 samples are not drawn.
    R² of a panel's title is over all samples and against persistence, which predicts no change.

    Args:
        predicted: Predicted change of each sensor `[T, S]`.
        true: True change of each sensor `[T, S]`.
        names: Name of each sensor `[S]`.

    Raises:
        ValueError: Arrays that are not `[T ≥ 1, S ≥ 1]`, or not finite.
    """
    guesses = finite_array("predicted", predicted, ("T", len(names)))
    truths = finite_array("true", true, guesses.shape)
    if not guesses.size:
        raise ValueError(f"expected one or more samples and sensors, got {guesses.shape}")
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    figure = new_figure(3.1 * columns + 0.4, 2.9 * rows + 0.5)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, name, guess, truth in zip(grid, names, guesses.T, truths.T, strict=False):
        tidy(axes, f"{name}, R² {_r_squared(guess, truth)}", "predicted change", "true change")
        axes.label_outer()
        axes.axline((0, 0), slope=1, color=GREY, linewidth=1, label="perfect")
        _draw_bins(axes, guess, truth)
    for axes in grid[len(names) :]:
        axes.remove()
    drawn = grid[0].get_legend_handles_labels()
    figure.legend(*drawn, loc="outside lower center", ncols=2, frameon=False)
    return figure


def fit_curves(train_loss: ArrayLike, validation_loss: ArrayLike) -> Figure:
    """Draw the losses of a fit over its epochs, with the best epoch marked.

    Args:
        train_loss: Loss on the training part after each epoch, > 0 `[E]`.
        validation_loss: Loss on the held-out part, > 0 `[E]`.

    Raises:
        ValueError: Losses that are not `[E ≥ 1]`, not finite or not positive.
    """
    trained = finite_array("train_loss", train_loss, ("E",))
    held_out = finite_array("validation_loss", validation_loss, (len(trained),))
    if not len(trained) or min(trained.min(), held_out.min()) <= 0:
        raise ValueError("expected losses > 0 of one or more epochs, got one ≤ 0 or none")
    figure = new_figure(7, 4)
    axes = figure.subplots()
    tidy(axes, "Fit of the forward model", "epoch", "loss")
    epochs, best = np.arange(1, len(trained) + 1), int(held_out.argmin())
    axes.plot(epochs, trained, color=BLUE, label="training")
    axes.plot(epochs, held_out, color=VERMILION, label="validation")
    label = f"best epoch, {epochs[best]}: validation {held_out[best]:#.3g}"
    axes.axvline(epochs[best], color=GREY, linewidth=5, alpha=0.4, zorder=0, label=label)
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.legend(frameon=False)
    return figure


def _draw_bins(axes: Axes, guess: NDArray, truth: NDArray) -> None:
    """Draw mean and standard deviation of the truth in bins of the guess."""
    borders = np.linspace(guess.min(), guess.max(), CALIBRATION_BINS + 1)
    bin_of = np.digitize(guess, borders[1:-1])
    members = [bin_of == index for index in range(CALIBRATION_BINS)]
    full = [member for member in members if member.sum() >= BIN_SAMPLES]
    axes.errorbar(
        [guess[member].mean() for member in full],
        [truth[member].mean() for member in full],
        [truth[member].std() for member in full],
        fmt="o",
        color=BLUE,
        markersize=4,
        linewidth=1,
        label="mean ± std",
    )


def _r_squared(guess: NDArray, truth: NDArray) -> str:
    """Return the share of the change explained, against predicting none."""
    change = (truth**2).sum()
    if change == 0:
        return "undefined"
    return f"{1 - ((truth - guess) ** 2).sum() / change:.2f}"
