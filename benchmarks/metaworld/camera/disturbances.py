"""How pictures may differ from those of the demonstrations while a learner acts.

A disturbance is drawn once for each episode; noise alone is drawn anew for each picture.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable

import numpy as np

from benchmarks.metaworld.camera.world import SIDE, Picture
from benchmarks.metaworld.features import Array

DARK, BRIGHT = 0.8, 1.25
NOISE = 10.0  # standard deviation, of 255
DISC = 12  # diameter of the clutter [pixels]
CLEAR = 22  # least distance of its middle from what matters [pixels]
NUDGE = 2  # [pixels]

Disturb = Callable[[Picture], Picture]
Draw = Callable[[np.random.Generator, Array], Disturb]
"""Draws a disturbance, given the pixels `[N, 2]` of what matters: its rows and columns."""


def dark(random: np.random.Generator, places: Array) -> Disturb:
    """Draw light that is weaker."""
    del random, places
    return lambda picture: _as_picture(picture * DARK)


def bright(random: np.random.Generator, places: Array) -> Disturb:
    """Draw light that is stronger."""
    del random, places
    return lambda picture: _as_picture(picture * BRIGHT)


def noise(random: np.random.Generator, places: Array) -> Disturb:
    """Draw errors of each number of each picture."""
    del places
    return lambda picture: _as_picture(picture + random.normal(0, NOISE, picture.shape))


def clutter(random: np.random.Generator, places: Array) -> Disturb:
    """Draw a disc of some colour in a place away from what matters."""
    colour = 255 * np.array(colorsys.hsv_to_rgb(random.uniform(), 0.9, 0.8))
    middle = away_from(places, random)
    rows, columns = np.ogrid[:SIDE, :SIDE]
    inside = np.hypot(rows - middle[0], columns - middle[1]) <= DISC / 2
    return lambda picture: _as_picture(np.where(inside[..., None], colour, picture))


def nudged(random: np.random.Generator, places: Array) -> Disturb:
    """Draw a camera that looks elsewhere by `NUDGE` pixels up, down, left or right."""
    del places
    rows, columns = ((NUDGE, 0), (-NUDGE, 0), (0, NUDGE), (0, -NUDGE))[random.integers(4)]
    down = np.clip(np.arange(SIDE) - rows, 0, SIDE - 1)
    right = np.clip(np.arange(SIDE) - columns, 0, SIDE - 1)
    return lambda picture: picture[down[:, None], right]


DISTURBANCES: dict[str, Draw] = {
    "dark": dark, "bright": bright, "noise": noise, "clutter": clutter, "nudged": nudged,
}  # fmt: skip
TITLES = {
    "": "as shown",
    "dark": f"light × {DARK:g}",
    "bright": f"light × {BRIGHT:g}",
    "noise": f"noise, sd {NOISE:g}",
    "clutter": f"a disc of {DISC} pixels",
    "nudged": f"camera nudged by {NUDGE} pixels",
}
"""Name -> how tables call it."""


def away_from(places: Array, random: np.random.Generator) -> Array:
    """Return a pixel `[2]` for a disc that is `CLEAR` of all places and of the ways between them.

    Args:
        places: `[N ≥ 1, 2]`, rows and columns, in the order of the ways.
        random: draws it.
    """
    shares = np.linspace(0, 1, 9)[:, None, None]
    ways = (places[:-1] + shares * np.diff(places, axis=0)).reshape(-1, 2)
    taken = np.concatenate([places, ways])
    free = np.arange(DISC / 2, SIDE - DISC / 2)
    grid = np.stack(np.meshgrid(free, free, indexing="ij"), axis=-1).reshape(-1, 2)
    apart = np.linalg.norm(grid[:, None] - taken, axis=-1).min(axis=1)
    return random.choice(grid[apart >= CLEAR])


def _as_picture(values: Array) -> Picture:
    """Return numbers `[SIDE, SIDE, 3]` as a picture."""
    return np.clip(values, 0, 255).astype(np.uint8)
