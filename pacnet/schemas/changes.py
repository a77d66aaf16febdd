"""How a percept has changed lately: where a demonstration was going when it came by.

Two demonstrations that come by one place may go on to different ones. The change over the last
third of a second of movement tells them apart. Time in which nothing moves does not count: in a
pause, and where a robot is held up, the change stays what it was.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
        from pacnet.schemas.change_kernels import changes_of  # imports numba

        out = np.empty_like(percepts)
        changes_of(percepts, self.kept, self.count, self.least, out)
        return out
