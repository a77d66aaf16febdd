"""How a percept has changed lately: where a demonstration was going when it came by.

Two demonstrations that come by one place may go on to different ones. The change over the last
third of a second of movement tells them apart. Time in which nothing moves does not count: in a
pause, and where a robot is held up, the change stays what it was.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pacnet.kernels.caching import cached_njit

HISTORY = 0.3  # [s] of movement


class RecentPercepts:
    """The last percepts of an episode that lie apart from one another.

    Args:
        dimensions: length D of a percept.
        fps: frames per second [1/s].
        least: distance, scaled, from which one percept lies apart from another.
    """

    def __init__(self, dimensions: int, fps: float, least: float) -> None:
        self.least = least
        self.kept = np.zeros((max(1, round(HISTORY * fps)) + 1, dimensions), np.float32)
        self.count = np.zeros(1, np.int64)

    def reset(self) -> None:
        """Forget all percepts."""
        self.count[0] = 0

    def changes(self, percepts: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the change at each of an episode's percepts `[T, D]`, scaled, in order of time."""
        out = np.empty_like(percepts)
        changes_of(percepts, self.kept, self.count, self.least, out)
        return out


@cached_njit(nogil=True)
def changes_of(percepts, kept, count, least, changes):
    """Write the change at each of an episode's percepts `[T, D]`."""
    for frame in range(len(percepts)):
        change_at(percepts[frame], kept, count, least, changes[frame])


@njit
def change_at(percept, kept, count, least, change):
    """Take one more percept `[D]` and write its change.

    Args:
        percept: scaled.
        kept: the last percepts that lie apart, a ring `[H, D]`.
        count: how many there have been so far, `[1]`.
        least: distance from which a percept lies apart from the last one kept.
        change: where to write, `[D]`.
    """
    size, number = len(kept), count[0]
    squared = 0.0
    if number > 0:
        last = kept[(number - 1) % size]
        for k in range(len(percept)):
            squared += (percept[k] - last[k]) ** 2
    if number == 0 or squared >= least * least:
        kept[number % size] = percept
        count[0] = number = number + 1
    oldest = kept[max(0, number - size) % size]
    for k in range(len(percept)):
        change[k] = percept[k] - oldest[k]
