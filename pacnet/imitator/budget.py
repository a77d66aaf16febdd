"""Which targets are kept where memory is bounded: what is novel stays, what is familiar goes.

Of a demonstration those frames are kept that the others do not foretell, its keyframes
(`pacnet.schemas.keyframes`). Where there are too many demonstrations to keep enough frames of each,
one goes that later ones of its task show again: the one whose frames have the nearest ones in
those. All tasks keep equally many, and no task is forgotten for want of frames.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.demonstration_memory import Shown
from pacnet.schemas.keyframes import importance, most_important

ENOUGH = 20  # frames of each demonstration, from which it can be followed
_COMPARED = 2_000  # rows; of more, every second, third, ... is compared

Numbers = NDArray[np.int64]


def kept_rows(shown: Shown, important: NDArray[np.float64], parts: Numbers, budget: int) -> Numbers:
    """Return the rows that are kept, ascending, `[K]`: no more than the budget.

    Args:
        shown: the keyframes of all demonstrations.
        important: how important each is, `[R]`; see `importances`.
        parts: number of the episode that each demonstration is of, which is kept or goes as a
            whole, ascending, `[E]`.
        budget: most rows that are kept.
    """
    of = parts.repeat(np.diff(shown.first))
    left = np.ones(len(of), bool)
    task = dict(zip(parts.tolist(), shown.task.tolist(), strict=True))
    known = list(dict.fromkeys(of.tolist()))
    ends = 2 * np.bincount(parts)  # at which a demonstration cannot be interpolated
    while len(known) > 1 and np.maximum(_enough(known, task), ends[known]).sum() > budget:
        gone = _most_familiar(shown.percepts, of, known, task)
        known.remove(gone)
        left &= of != gone
    rows = np.flatnonzero(left)
    return rows[most_important(important[rows], budget)]


def _enough(known: list[int], task: dict[int, int]) -> int:
    """Return how many frames an episode needs: few are better than to forget a whole task."""
    return ENOUGH if len(known) > len({task[one] for one in known}) else 0


def importances(shown: Shown, last: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how important each row is, `[R]`.

    Args:
        shown: the keyframes of all demonstrations.
        last: the importance of those of the last one, which was measured among all its frames.
    """
    before = [
        importance(shown.percepts[first:end], shown.frame[first:end])
        for first, end in zip(shown.first[:-2], shown.first[1:-1], strict=True)
    ]
    return np.concatenate([*before, last])


def _most_familiar(
    percepts: NDArray[np.float32], of: Numbers, known: list[int], task: dict[int, int]
) -> int:
    """Return the episode, of the tasks with the most of them, that later ones show best."""
    counts = Counter(task[one] for one in known)
    most, nearest = max(counts.values()), {}
    for index, one in enumerate(known):
        if counts[task[one]] == most:
            later = [other for other in known[index + 1 :] if task[other] == task[one]]
            nearest[one] = _distance(percepts[of == one], percepts[np.isin(of, later)])
    return min(nearest, key=nearest.__getitem__)  # the first of equal ones


def _distance(percepts: NDArray[np.float32], others: NDArray[np.float32]) -> float:
    """Return the mean distance of percepts `[N, D]` from the nearest of others `[M, D]`."""
    if len(others) == 0:
        return np.inf
    own, some = (
        rows[:: 1 + len(rows) // _COMPARED].astype(np.float64) for rows in (percepts, others)
    )
    squares = np.square(own).sum(1)[:, None] + np.square(some).sum(1) - 2 * own @ some.T
    return float(np.sqrt(np.maximum(squares.min(axis=1), 0)).mean())
