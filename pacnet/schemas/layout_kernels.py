"""The layout of a scene, in numbers: where everything is relative to everything else.

It says nothing of where in the world the scene is. Places are in shares of the scene's size, turns
are two axes each, and what is no point counts little.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pacnet.kernels.caching import cached_njit

TURN = 0.5  # weight of an axis, of length 1, beside places in shares of the scene's size
OTHER = 0.05  # weight of what is no point, in shares of its range


@njit
def length(points, others):
    """Return the number of a layout's features."""
    landmarks = points - 1
    return 3 * landmarks + 3 * landmarks * (landmarks - 1) // 2 + 6 * points + others


@njit
def layout_at(places, turns, others, extent, out):
    """Write the layout of one scene: places `[P, 3]`, turns `[P, 4]`, others `[Q]`."""
    at, points = 0, len(places)
    for i in range(1, points):
        for j in range(i):
            for k in range(3):
                out[at] = (places[i, k] - places[j, k]) / extent
                at += 1
    for i in range(points):
        w, x, y, z = turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3]
        out[at], out[at + 1] = TURN * (1 - 2 * (y * y + z * z)), TURN * 2 * (x * y + w * z)
        out[at + 2], out[at + 3] = TURN * 2 * (x * z - w * y), TURN * 2 * (x * y - w * z)
        out[at + 4], out[at + 5] = TURN * (1 - 2 * (x * x + z * z)), TURN * 2 * (y * z + w * x)
        at += 6
    for k in range(len(others)):
        out[at + k] = OTHER * others[k]


@cached_njit(nogil=True)
def layouts(places, turns, others, extent):
    """Return the layouts of N scenes, `[N, F]`; arguments as of `layout_at`, with N rows."""
    out = np.empty((len(places), length(places.shape[1], others.shape[1])))
    for row in range(len(places)):
        layout_at(places[row], turns[row], others[row], extent, out[row])
    return out
