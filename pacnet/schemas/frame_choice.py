"""Checks by leaving one out in whose frame a segment is shown to end, where there are several.

Attention says on the way to which landmark a demonstration is. Two demonstrations of the same
segment say more: its end is alike in the frame that it belongs to. The world is a candidate.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.scene import WORLD, Scene, conjugate, landmark_of, rotate

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_BETTER = 0.5  # share of the error in the frame of attention that is left in a better one
_WRONG = 0.05  # share of the scene's size that the error is, at least, for attention to be wrong
_AT_REST = 0.5  # share of a segment's frames in which a landmark rests, to be a candidate


def choose_landmarks(
    scene: Scene,
    carried: NDArray[np.bool_],
    cuts: Mapping[str, Numbers],
    kinds: Numbers,
    extent: float,
) -> Numbers:
    """Return in whose frame each segment is kept, `[S]`.

    Args:
        scene: of all rows.
        carried: whether each landmark moves, `[R, M]`.
        cuts: see `SegmentMemory.columns`.
        kinds: which segments show the same, by number, −1 for those that are not compared, `[S]`.
        extent: size of the scene.
    """
    landmark = cuts["landmark"].copy()
    end = cuts["frames"].cumsum()
    resting = ~carried
    still = np.add.reduceat(resting, end - cuts["frames"]) / cuts["frames"][:, None]
    ends = Scene(scene.places[end - 1], scene.turns[end - 1])
    candidates = range(WORLD, carried.shape[1])
    seen = np.stack([_seen_from(ends, number) for number in candidates])  # [1 + M, S, 3]
    for kind in set(kinds[kinds >= 0].tolist()):
        alike = np.flatnonzero(kinds == kind)
        if len(alike) < 2:
            continue
        own = int(cuts["landmark"][alike[0]])
        errors = {number: _left_out(seen[number + 1, alike]) for number in candidates}
        at_rest = [
            number
            for number in candidates
            if number == WORLD or (still[alike, number] >= _AT_REST).all()
        ]
        best = min(at_rest, key=errors.__getitem__)
        if errors[own] > _WRONG * extent and errors[best] < _BETTER * errors[own]:
            landmark[alike] = best
    return landmark


def _seen_from(scene: Scene, number: int) -> Array:
    """Return the moved point's place in the frame of a landmark, `[S, 3]`."""
    origin, axes = landmark_of(scene, np.full(len(scene.places), number))
    return rotate(conjugate(axes), scene.places[:, 0] - origin)


def _left_out(places: Array) -> float:
    """Return the mean distance of each place `[N ≥ 2, 3]` from the mean of the others."""
    others = (places.sum(axis=0) - places) / (len(places) - 1)
    return float(np.linalg.norm(places - others, axis=1).mean())
