"""Finds which landmarks are carried away and put back where they stood, in most demonstrations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pacnet.attention.cutting import Size, across_gaps, carried, was_put_back
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.records import task_name

Array = NDArray[np.float64]


def find_put_back(
    places: Sequence[Array], demonstrations: Demonstrations, size: Size
) -> tuple[int, ...]:
    """Return the numbers of the landmarks that are put back in most demonstrations of some task.

    Args:
        places: of the moved point and M landmarks in each demonstration, `[T, 1 + M, 3]`.
        demonstrations: continuous ones; those of one episode are parts of it, between its gaps.
        size: of the scene.
    """
    episodes: list[tuple[str, list[Array]]] = []
    before = None
    for place, shown in zip(places, demonstrations, strict=True):
        if shown.first_frame == 0 or shown.episode != before:
            episodes.append((task_name(shown.task), []))
        episodes[-1][1].append(place)
        before = shown.episode
    by_task: dict[str, list[NDArray[np.bool_]]] = {}
    for task, parts in episodes:
        by_task.setdefault(task, []).append(_are_put_back(parts, size, demonstrations.fps))
    usual = [2 * np.sum(own, axis=0) > len(own) for own in by_task.values()]
    return tuple(np.flatnonzero(np.any(usual, axis=0)).tolist())


def _are_put_back(parts: Sequence[Array], size: Size, fps: float) -> NDArray[np.bool_]:
    """Return which landmarks are carried away and back in an episode, bool `[M]`."""
    gaps = np.cumsum([len(part) for part in parts])[:-1].tolist()
    moves = across_gaps(np.concatenate([carried(part, size, fps) for part in parts]), gaps, fps)
    places = np.concatenate(parts)[:, 1:]
    apart = np.linalg.norm(places - places[0], axis=2)
    return np.array([was_put_back(*own, size) for own in zip(apart.T, moves.T, strict=True)])
