"""Demonstrations as they would be with other goals: postures on the way are moved along.

Where nothing is a point, such as with joint angles, a goal is a posture. What it differs by from
the one that was shown is added to the postures on the way there, more and more: nothing at the
beginning, all of it at the goal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.demonstration_memory import Shown, with_boxes

Array = NDArray[np.floating]


def warped(
    shown: Shown,
    episodes: Sequence[tuple[int, int]],
    apart: Array,
    shares: Sequence[float],
    unit: Array,
    follows: NDArray[np.int64],
    lead: int,
) -> Shown:
    """Return demonstrations whose goals are others.

    Args:
        shown: the demonstrations.
        episodes: the first row of each episode that is warped, and the one after its last.
        apart: by how much its goals are to differ from those shown, scaled, `[N, G, S]`, of the
            first S dimensions of a percept.
        shares: of an episode's time, ascending up to 1, when its goals are attained, `[G]`.
        unit: what one of a scaled percept is in its own unit, `[D]`.
        follows: the dimension of the percept that each target is a place of, −1 for none, `[A]`.
        lead: frames that targets lie ahead.
    """
    percepts, targets = shown.percepts.copy(), shown.targets.copy()
    size = apart.shape[2]
    moved = np.flatnonzero((follows >= 0) & (follows < size))
    of, knots = follows[moved], np.r_[0.0, shares]
    for (first, end), own in zip(episodes, apart, strict=True):
        values = np.concatenate([np.zeros((1, size)), own])
        time = np.arange(end - first) / max(1, end - first - 1)
        ahead = np.minimum(1.0, time + lead / max(1, end - first - 1))
        for dimension in range(size):
            percepts[first:end, dimension] += np.interp(time, knots, values[:, dimension])
        for target, dimension in zip(moved, of, strict=True):
            change = np.interp(ahead, knots, values[:, dimension])
            targets[first:end, target] += change * unit[dimension]
    return with_boxes(shown._replace(percepts=percepts, targets=targets))
