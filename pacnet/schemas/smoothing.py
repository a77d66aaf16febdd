"""Smoothing of places by as much as they are noisy: an alpha-beta filter, and its twin for records.

A place goes on at its last speed; what is seen instead corrects place and speed. How much depends
on the noise against how much speed changes from frame to frame (the tracking index of Kalata, 1984:
the steady state of a Kalman filter). Without noise, the place is the one that is seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.points import Points
from pacnet.schemas.scene import Scene, scene_of

Array = NDArray[np.float64]

_THIRD = 0.6745 * 20**0.5  # median size of third differences of white noise of deviation 1
_SHORTEST = 5  # frames over which a change of speed is looked for, and twice as many, and so on
_CERTAIN = 1.5  # times as much as noise alone would give
_LEAST = 0.05  # alpha: what never moved may yet be moved
_CLEAR = 0.9  # alpha from which nothing is smoothed


def choose_smoothing(places: Sequence[Array]) -> tuple[tuple[float, float], ...]:
    """Return alpha and beta for each of P points.

    Args:
        places: of each demonstration, `[T, P, 3]`.
    """
    count = places[0].shape[1]
    return tuple(_gains([episode[:, number] for episode in places]) for number in range(count))


def _gains(places: Sequence[Array]) -> tuple[float, float]:
    """Return alpha and beta of a point from its places in each demonstration, `[T, 3]`."""
    thirds = np.concatenate([np.diff(episode, n=3, axis=0) for episode in places])
    if len(thirds) == 0:
        return 1.0, 1.0
    noise = float(np.median(np.abs(thirds), axis=0).max()) / _THIRD
    if noise == 0:
        return 1.0, 1.0
    longest, change, span = max(map(len, places)), 0.0, _SHORTEST
    while 3 * span <= longest:
        change = max(change, _change_of_speed(places, noise, span))
        span *= 2
    index = change / noise
    root = (4 + index - np.sqrt(8 * index + index**2)) / 4 if index < 1e6 else 0.0
    alpha = max(_LEAST, float(1 - root**2))
    beta = float(2 * (2 - alpha) - 4 * root)
    return alpha, min(1.0, max(0.0, beta))


def _change_of_speed(places: Sequence[Array], noise: float, span: int) -> float:
    """Return the change of speed from frame to frame that is beyond doubt, in any dimension."""
    changes = [
        episode[2 * span :] - 2 * episode[span:-span] + episode[: -2 * span]
        for episode in places
        if len(episode) > 2 * span
    ]
    squared = np.square(np.concatenate(changes)).mean(axis=0).max()
    return float(np.sqrt(max(0.0, squared - _CERTAIN * 6 * noise**2))) / span**2


def smoothed_scene(
    percepts: NDArray[np.floating], points: Points, gains: Sequence[tuple[float, float]]
) -> Scene:
    """Return where the points of a whole demonstration's percepts `[T, D]` are, filtered."""
    seen = scene_of(percepts, points)
    return Scene(smooth(seen.places, gains), seen.turns)


def smooth(places: Array, gains: Sequence[tuple[float, float]]) -> Array:
    """Return places `[T, P, 3]` of a whole demonstration, filtered forwards and backwards."""
    table = np.array(gains)
    if (table[:, 0] >= _CLEAR).all():
        return places
    both = (_filter(places, table) + _filter(places[::-1], table)[::-1]) / 2
    return np.where((table[:, 0] >= _CLEAR)[:, None], places, both)


def moving_average(rows: NDArray[np.floating], frames: int) -> Array:
    """Return rows `[T, D]`, each the mean of so many around it, an odd number."""
    half = max(0, frames // 2)
    padded = np.pad(rows.astype(np.float64), ((half, half), (0, 0)), mode="edge")
    sums = np.concatenate([np.zeros((1, rows.shape[1])), padded.cumsum(axis=0)])
    return (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)


def _filter(places: Array, gains: Array) -> Array:
    """Return places `[T, P, 3]`, filtered in order of time."""
    out, place, speed = np.empty_like(places), places[0].copy(), np.zeros_like(places[0])
    for frame, seen in enumerate(places):
        expected = place + speed
        apart = seen - expected
        place = expected + np.maximum(gains[:, :1], 1 / (frame + 1)) * apart
        speed = speed + gains[:, 1:] * apart if frame else speed
        out[frame] = place
    return out
