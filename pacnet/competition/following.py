"""Following demonstrations: the current target of each motor schema, and which of them act.

A motor schema is a sequence, and recall gives "the *current* internal target" (Maistros, Marom &
Hayes 2001). Here the position in the sequence is found from the percepts. It advances as far as the
robot follows, waits where it is held up, goes through pauses that were shown, and is found again
after a push or when an episode begins in the middle. Of all demonstrations those that fit best
are followed, each at a position of its own, and the best of these act together.

What a position target is off at the beginning fades along the way, as in a movement primitive; what
it is off later is led back at once, but for a share. Other actions are corrected linearly
(`pacnet.forward_models.correction`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.forward_models.correction import Correction
from pacnet.schemas.changes import RecentPercepts
from pacnet.schemas.demonstration_memory import Shown

WINDOW = 0.5  # [s] before and after the expected moment in which the present one is looked for
JUMP_TIME = 0.6  # [s] over which a better moment elsewhere must fit better
SEARCHED = 50_000  # frames; a search of more is spread over several steps


class Settings(NamedTuple):
    """What following depends on beside the demonstrations."""

    follows: NDArray[np.float64]
    """1 for the dimensions of a percept that position targets move, else 0, `[D]`."""
    change_ratio: NDArray[np.float64]
    """Factor on each dimension's change, `[D]`."""
    least: float
    """Distance, scaled, that counts as movement."""
    window: float
    """`WINDOW` in frames."""
    late: float
    """The last frame that counts as a demonstration's beginning."""
    jump_rate: float
    """Smoothing of the excess, for each search."""
    every: int
    """Steps after which each demonstration has been searched."""


class State(NamedTuple):
    """A recall episode. K demonstrations are followed; where there are fewer, −1."""

    demonstration: NDArray[np.int64]  # [K]
    row: NDArray[np.int64]  # [K], the present moment
    time: NDArray[np.float64]  # [K] [frames], between moments too
    moved: NDArray[np.float32]  # [K, D], scaled, offset where following began, of places
    gone: NDArray[np.float64]  # [K], its square
    ahead: NDArray[np.float64]  # [K] [frames] that were left there
    excess: NDArray[np.float64]  # [K], by how much another moment fits better
    mismatch: NDArray[np.float64]  # [K], squared, of percepts
    change_mismatch: NDArray[np.float64]  # [K], squared, of changes
    cost: NDArray[np.float64]  # [K], how badly each fits; huge where there is none
    weight: NDArray[np.float64]  # [K], in the action; sums to 1
    heaviest: NDArray[np.int64]  # [1], index of the largest weight
    progress: NDArray[np.float64]  # [1]
    nearest: NDArray[np.int64]  # [1], row of the nearest percept found
    distance: NDArray[np.float64]  # [1], squared, to it
    steps: NDArray[np.int64]  # [1]
    kept: NDArray[np.float32]  # [H, D], see `RecentPercepts`
    kept_count: NDArray[np.int64]  # [1]
    change: NDArray[np.float32]  # [D], how the percept has changed


class Follower:
    """A recall episode, percept by percept.

    Args:
        recent: of the percepts of this episode.
        change_ratio: factor on each dimension's change, `[D]`.
        fps: frames per second [1/s].

    Attributes:
        state: see `State`.
    """

    def __init__(
        self, recent: RecentPercepts, change_ratio: NDArray[np.float64], fps: float
    ) -> None:
        from pacnet.competition.following_kernels import FOLLOWED  # imports numba

        self._recent, self._ratio, self._fps = recent, change_ratio, fps
        dimensions = len(change_ratio)
        self.state = State(
            demonstration=np.zeros(FOLLOWED, np.int64),
            row=np.zeros(FOLLOWED, np.int64),
            time=np.zeros(FOLLOWED),
            moved=np.zeros((FOLLOWED, dimensions), np.float32),
            gone=np.zeros(FOLLOWED),
            ahead=np.zeros(FOLLOWED),
            excess=np.zeros(FOLLOWED),
            mismatch=np.zeros(FOLLOWED),
            change_mismatch=np.zeros(FOLLOWED),
            cost=np.zeros(FOLLOWED),
            weight=np.zeros(FOLLOWED),
            heaviest=np.zeros(1, np.int64),
            progress=np.zeros(1),
            nearest=np.zeros(1, np.int64),
            distance=np.zeros(1),
            steps=np.zeros(1, np.int64),
            kept=recent.kept,
            kept_count=recent.count,
            change=np.zeros(dimensions, np.float32),
        )
        self.reset()

    def reset(self) -> None:
        """Begin a new episode."""
        from pacnet.competition.following_kernels import NOTHING

        self.state.demonstration[:] = -1
        self.state.weight[:] = 0
        self.state.cost[:] = NOTHING
        self.state.heaviest[:] = self.state.nearest[:] = -1
        self.state.progress[:] = self.state.steps[:] = 0
        self._recent.reset()

    def settings(self, shown: Shown, correction: Correction) -> Settings:
        """Return the settings for these demonstrations."""
        follows = np.zeros(len(self._ratio))
        follows[correction.follows[correction.follows >= 0]] = 1
        every = 1 + len(shown.percepts) // SEARCHED
        return Settings(
            follows,
            self._ratio,
            self._recent.least,
            max(2.0, WINDOW * self._fps),
            max(1.0, WINDOW / 2 * self._fps),
            min(1.0, every / (JUMP_TIME * self._fps)),
            every,
        )
