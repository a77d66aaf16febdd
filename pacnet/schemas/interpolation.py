"""What is between keyframes: demonstrations as they are followed.

A stretch between two keyframes takes as long as it took when it was shown. Only where next to
nothing changed, such as while the demonstrator rested, it takes less: nobody waits where there is
nothing to wait for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pacnet.schemas.demonstration_memory import Shown

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_SLOWEST = 0.1  # of the usual speed, at which a stretch is passed at least
_TIE = 1e-6  # relative; numbers this near are equal, as sums differ a little between machines


def durations(percepts: NDArray[np.floating], frame: Numbers, rows: Numbers) -> Numbers:
    """Return the frames from each row to the next one of its demonstration, 0 at the last, `[R]`.

    Args:
        percepts: scaled, `[R, D]`.
        frame: number of each in its demonstration, `[R]`.
        rows: number of those of each demonstration, `[E]`; they lie one after the other.
    """
    lasting = np.zeros(len(percepts), np.int64)
    for end, count in zip(np.cumsum(rows), rows, strict=True):
        own = slice(end - count, end)
        lasting[own][:-1] = _of_one(percepts[own].astype(np.float64), frame[own])
    return lasting


def _of_one(percepts: Array, frame: Numbers) -> Numbers:
    """Return the frames from each row of one demonstration to the next, `[T − 1]`."""
    shown = np.diff(frame)
    if (shown == 1).all():
        return shown
    way = np.linalg.norm(np.diff(percepts, axis=0), axis=1)
    speed = way / shown
    order = np.argsort(speed, kind="stable")
    passed = way[order].cumsum()  # half of the way is passed at the usual speed or more
    usual = speed[order][np.searchsorted(passed, (1 - _TIE) * passed[-1] / 2)]
    if usual == 0:  # nothing ever changed
        return np.ones_like(shown)
    least = np.ceil((1 - _TIE) * way / (_SLOWEST * usual))
    return np.minimum(shown, np.maximum(1, least).astype(np.int64))


def interpolated(shown: Shown) -> Shown:
    """Return demonstrations with all frames between those that are kept, to be followed.

    Args:
        shown: what is kept; it is returned itself where no frame is missing.
    """
    rows = np.diff(shown.first)
    if (rows == shown.frames).all():
        return shown
    lasting = durations(shown.percepts, shown.frame, rows)
    counts = lasting + _is_last(rows)  # frames from each row on, before the next
    before = np.repeat(np.arange(len(lasting)), counts)
    begin = counts.cumsum() - counts
    share = (np.arange(len(before)) - begin[before]) / np.maximum(1, lasting[before])
    after = np.minimum(before + 1, len(lasting) - 1)

    def between(values: NDArray[np.floating]) -> NDArray[np.float32]:
        columns = share[:, None]
        return ((1 - columns) * values[before] + columns * values[after]).astype(np.float32)

    frames = played(lasting, rows)
    first = np.r_[0, frames.cumsum()]
    frame = (1 - share) * shown.frame[before] + share * shown.frame[after]
    return shown._replace(
        percepts=between(shown.percepts),
        changes=between(shown.changes),
        targets=between(shown.targets),
        time=np.arange(first[-1]) - np.repeat(first[:-1], frames),
        frame=np.floor(frame + _TIE).astype(np.int64),
        first=first,
        frames=frames,
    )


def played(lasting: Numbers, rows: Numbers) -> Numbers:
    """Return how many frames each demonstration has when it is followed, `[E]`.

    Args:
        lasting: see `durations`.
        rows: number of those of each demonstration, `[E]`.
    """
    total = np.r_[0, lasting.cumsum()]
    end = rows.cumsum()
    return total[end] - total[end - rows] + (rows > 0)


def _is_last(rows: Numbers) -> Numbers:
    """Return 1 for each row that is the last one of its demonstration, else 0, `[R]`."""
    last = np.zeros(rows.sum(), np.int64)
    last[rows.cumsum()[rows > 0] - 1] = 1
    return last
