"""The figure of what cameras see, beside the remembered picture that drives the action."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from pacnet.evaluation.figure_style import COLOURS, GREY, INK, LABEL_SIZE, new_figure, wrapped

_SIDE = 3.9  # [inches], width of a picture
_TITLE_WIDTH, _TEXT_WIDTH = 80, 90  # [characters]
_ABOVE, _BELOW = 0.4, 0.45  # [inches], of the headline and of the words below
_BETWEEN = 0.7  # [inches], for the words over and under each row
# The brightest first: a box must be seen on a picture of any colour.
_BOXES = ("#e69f00", "#56b4e9", "#cc79a7", *COLOURS[:3])


class Picture(NamedTuple):
    """A picture, and what is attended to in it."""

    pixels: NDArray[np.uint8]
    """`[h, w, 3]`."""
    boxes: Sequence[Sequence[float]]
    """Left, top, right and bottom of each, in shares of the picture."""
    title: str
    is_found: bool = True
    """Whether that is what is attended to, or only where it would be; then boxes are dashed."""


class Sighting(NamedTuple):
    """What one camera sees and what is remembered."""

    camera: str
    now: Picture
    remembered: Picture | None
    """None where none is."""
    about: str
    """How alike they are, in words."""


def beside_remembered(sightings: Sequence[Sighting], headline: str, words: str) -> Figure:
    """Draw a row for each camera: what it sees on the left, what is remembered on the right.

    What is attended to has a box of the same colour and number in both.

    Args:
        sightings: of each camera.
        headline: what is decided.
        words: what is done, below the pictures.

    Raises:
        ValueError: no camera.
    """
    if not sightings:
        raise ValueError("expected what one camera sees at least, got none")
    heights = [_SIDE * one.now.pixels.shape[0] / one.now.pixels.shape[1] for one in sightings]
    total = sum(heights) + _BETWEEN * len(heights) + _ABOVE + _BELOW
    figure = new_figure(2 * _SIDE + 0.3, total)
    figure.suptitle(wrapped(headline, _TITLE_WIDTH), x=0.01, ha="left", fontsize=12)
    rows = figure.subplots(len(sightings), 2, squeeze=False, height_ratios=heights)
    for (left, right), one in zip(rows, sightings, strict=True):
        _draw(left, one.now)
        if one.remembered is None:
            right.set_axis_off()
            right.set_title("no picture is remembered", fontsize=9, loc="left")
        else:
            _draw(right, one.remembered)
        left.set_xlabel(
            wrapped(f"{one.camera}, {one.about}", _TEXT_WIDTH), loc="left", size=LABEL_SIZE
        )
    figure.supxlabel(wrapped(words, _TEXT_WIDTH), x=0.01, ha="left", fontsize=10, color=INK)
    return figure


def _draw(axes: Axes, picture: Picture) -> None:
    """Draw a picture with its boxes, in shares of its width and height."""
    height, width = picture.pixels.shape[:2]
    axes.imshow(picture.pixels, extent=(0, width, height, 0), interpolation="antialiased")
    axes.set_title(picture.title, fontsize=9, loc="left")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_color(GREY)
    for number, (left, top, right, bottom) in enumerate(picture.boxes):
        corners = (left * width, top * height, right * width, bottom * height)
        _box(axes, number, corners, picture.is_found)


def _box(
    axes: Axes, number: int, corners: tuple[float, float, float, float], is_found: bool
) -> None:
    """Draw a box in the colour of its number, with that beside it."""
    left, top, right, bottom = corners
    colour = _BOXES[number % len(_BOXES)]
    place = {"xy": (left, top), "width": right - left, "height": bottom - top, "fill": False}
    axes.add_patch(Rectangle(**place, edgecolor="black", linewidth=3.5))
    line, name = ("-", f"{number + 1}") if is_found else ((0, (2, 1.5)), f"{number + 1}?")
    axes.add_patch(Rectangle(**place, edgecolor=colour, linewidth=2, linestyle=line))
    axes.annotate(
        name, (right, top), (3, 1), textcoords="offset points", size=11, weight="bold",
        color=colour, path_effects=[withStroke(linewidth=2.5, foreground="black")],
    )  # fmt: skip
