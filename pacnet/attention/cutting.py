"""Attention cuts a demonstration where the landmark that the moved point is on its way to changes.

Of the landmarks at rest it is the one that is attained first. A landmark is attained when the
moved point comes near and slows down, or when it is set in motion, or, where neither happens, at
the least distance. A landmark that moves is carried or pushed, and no place to go to. Neither is
one that the moved point never approaches. A segment is a stretch in which the landmark is the
same. All distances are shares of what was shown, and all numbers of frames times.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MOVES = 0.2  # share of the moved point's usual speed from which a landmark moves
_APART = 1.0  # share of its way by which a carried landmark's way may differ from the moved point's
_GONE = 0.02  # share of the scene's size by which what is carried gets away from its middle
_MOSTLY = 0.9  # share of the frames that may be nearer: noise is farther in single ones
_LEFT = 0.05  # share of the scene's size by which what was carried must be left behind
_WINDOW = 0.05  # [s] before and after a moment in which speed is measured
_NEAR = 0.3  # share of the scene's size at which a landmark is near, at most
_SHARE = 0.35  # of the farthest distance from a landmark that is left where it is near
_CLOSE = 0.05  # share of the scene's size that is near in any case
_REACH = 0.6  # share of the scene's size within which what is set in motion was set so on purpose
_APPROACHED = 0.75  # of the farthest distance so far: nearer, a landmark was approached
_SLOW = 0.5  # share of the moved point's usual speed below which it slows down
_TOGETHER = 0.125  # [s] within which two landmarks are attained at once; the nearer one counts
_SHORTEST = 0.1  # [s] of a segment


class Size(NamedTuple):
    """What is far and fast in a scene, in the units of places and frames."""

    extent: float
    """Diagonal of the box in which the moved point moves, the median over demonstrations."""
    speed: float
    """Its usual speed, a quadratic mean [1/frame]."""


def measure(places: list[Array], fps: float) -> Size:
    """Return the size of the scene, from the moved point's places `[T, 3]` in demonstrations."""
    window = max(1, round(_WINDOW * fps))
    extent = float(np.median([np.linalg.norm(np.ptp(place, axis=0)) for place in places]))
    speeds = np.concatenate([_speed(place, *_around(len(place), window)) for place in places])
    return Size(extent, float(np.sqrt(np.square(speeds).mean())))


def carried(places: Array, size: Size, fps: float) -> NDArray[np.bool_]:
    """Return whether each landmark is carried or pushed by the moved point, bool `[T, M]`.

    It moves if it does in both halves of a window: one that is reported late has not moved. One
    that falls into place while the moved point goes elsewhere is not carried, and neither is one
    that gets nowhere: that is noise. What comes to rest is carried until it is left.

    Args:
        places: of the moved point and M landmarks, `[T, 1 + M, 3]`.
        size: of the scene.
        fps: frames per second [1/s].
    """
    before, after = _around(len(places), max(1, round(_WINDOW * fps)))
    middle = (before + after) // 2
    slower = np.minimum(_speed(places, before, middle), _speed(places, middle, after))
    moves = slower[:, 1:] > _MOVES * size.speed
    ways = places[after] - places[before]
    apart = np.linalg.norm(ways[:, 1:] - ways[:, :1], axis=2)
    moves &= apart < _APART * np.linalg.norm(ways[:, 1:], axis=2)
    held = _until_left(moves, places[:, 1:] - places[:, :1], _LEFT * size.extent)
    for number in range(held.shape[1]):
        for first, end in runs(held[:, number].astype(np.int64)):
            way = places[first:end, 1 + number][moves[first:end, number]]  # it may rest for long
            if len(way):
                gone = np.linalg.norm(way - np.median(way, axis=0), axis=1)
                held[first:end, number] = np.quantile(gone, _MOSTLY) > _GONE * size.extent
    return held


def _until_left(moves: NDArray[np.bool_], hold: Array, least: float) -> NDArray[np.bool_]:
    """Return moves `[T, M]`, and rests in which the way `[T, M, 3]` to what moved is the same."""
    held, since = moves.copy(), hold[0].copy()
    for frame in range(1, len(held)):
        near = np.linalg.norm(hold[frame] - since, axis=1) <= least
        held[frame] |= held[frame - 1] & near
        since[moves[frame]] = hold[frame, moves[frame]]
    return held


def across_gaps(moves: NDArray[np.bool_], gaps: Sequence[int], fps: float) -> NDArray[np.bool_]:
    """Return what is carried, also about gaps, if it is before and after: there no speed is known.

    Args:
        moves: whether each landmark is carried, `[T, M]`.
        gaps: the first frame after each.
        fps: frames per second [1/s].
    """
    moves, about = moves.copy(), 2 * max(1, round(_WINDOW * fps))
    for gap in gaps:
        before, after = slice(max(0, gap - about), gap), slice(gap, gap + about)
        both = moves[before].any(axis=0) & moves[after].any(axis=0)
        moves[before] |= both
        moves[after] |= both
    return moves


def cut(places: Array, size: Size, fps: float, put_back: Sequence[int] = ()) -> NDArray[np.int64]:
    """Return the landmark that the moved point is on its way to, `[T]`, −1 for none.

    There is none where all landmarks move, where the moved point approaches none of the others
    in the whole demonstration, or once it has left for good those that it was at.

    Args:
        places: of the moved point and M landmarks, `[T, 1 + M, 3]`.
        size: of the scene.
        fps: frames per second [1/s].
        put_back: numbers of the landmarks whose former places are the last of the landmarks.
    """
    distances = np.linalg.norm(places[:, 1:] - places[:, :1], axis=2)
    moves = carried(places, size, fps)
    calm = _calm(places[:, 0], size, fps)
    possible = _gone_to(distances, moves, size) & ~moves & ~_left_for_good(distances, calm, size)
    former = distances.shape[1] - len(put_back)
    possible[:, former:] = False
    together = max(1, round(_TOGETHER * fps))
    frames, landmarks = distances.shape
    attained = np.full(frames, -1)
    for frame in range(frames):
        best = (frames, np.inf)
        for number in range(landmarks):
            if possible[frame, number]:
                first, least = _attained(distances[:, number], moves[:, number], calm, frame, size)
                if (first // together, least) < best:
                    best, attained[frame] = (first // together, least), number
    for number, of in enumerate(put_back, start=former):
        apart = np.linalg.norm(places[:, 1 + number] - places[:, 1 + of], axis=1)
        attained[_on_the_way_back(apart, moves[:, of], size)] = number
    return _without_short(attained, max(1, round(_SHORTEST * fps)))


def _gone_to(distances: Array, moves: NDArray[np.bool_], size: Size) -> NDArray[np.bool_]:
    """Return whether the moved point ever approaches each landmark or sets it in motion, `[M]`."""
    farthest = np.maximum.accumulate(distances, axis=0)
    near = distances <= np.maximum(_APPROACHED * farthest, _CLOSE * size.extent)
    return np.logical_or.reduce(near | moves, axis=0)


def _left_for_good(distances: Array, calm: NDArray[np.bool_], size: Size) -> NDArray[np.bool_]:
    """Return whether the moved point was last at each landmark, and ends elsewhere, `[T, M]`.

    One at which it begins it has not come to, so it is still a landmark on the way from there.
    """
    farthest = np.maximum.accumulate(distances, axis=0)
    came = (farthest > _CLOSE * size.extent) & (distances <= _APPROACHED * farthest)
    there = came & (distances <= _near(farthest, size)) & calm[:, None]
    later = np.logical_or.accumulate(there[::-1], axis=0)[::-1]
    return ~later & there.any(axis=0)


def _near(farthest: Array, size: Size) -> Array:
    """Return the distance within which a landmark is near, from the farthest one so far."""
    return np.minimum(_NEAR * size.extent, np.maximum(_SHARE * farthest, _CLOSE * size.extent))


def was_put_back(apart: Array, moves: NDArray[np.bool_], size: Size) -> bool:
    """Return whether a landmark was carried away and back.

    Args:
        apart: distance from where it stood, `[T]`.
        moves: whether it is carried, `[T]`.
        size: of the scene.
    """
    return bool(_on_the_way_back(apart, moves, size).any())


def _on_the_way_back(apart: Array, moves: NDArray[np.bool_], size: Size) -> NDArray[np.bool_]:
    """Return when a landmark is carried back to where it stood: once it was farthest, `[T]`."""
    back = np.zeros(len(apart), bool)
    for first, end in runs(moves.astype(np.int64)):
        way = apart[first:end]
        away, close = way.max() > _NEAR * size.extent, _CLOSE * size.extent
        if moves[first] and away and way[-1] <= close:
            back[first + np.flatnonzero(way >= way.max() - close)[-1] + 1 : end] = True
    return back


def _calm(place: Array, size: Size, fps: float) -> NDArray[np.bool_]:
    """Return whether the moved point `[T, 3]` slows down, or the demonstration ends, bool `[T]`."""
    window = max(1, round(_WINDOW * fps))
    slow = _speed(place, *_around(len(place), window)) < _SLOW * size.speed
    slow[-2 * window :] = True
    return slow


def _attained(
    distances: Array, moves: NDArray[np.bool_], calm: NDArray[np.bool_], frame: int, size: Size
) -> tuple[int, float]:
    """Return when a landmark is attained after a frame, and the least distance until it moves.

    One that is only passed is not attained.
    """
    moved = np.flatnonzero(moves[frame:])
    until = int(moved[0]) if len(moved) else len(distances) - frame
    ahead = distances[frame : frame + until]
    least, near = float(ahead.min()), _near(distances[: frame + 1].max(), size)
    there = (ahead <= near) & calm[frame : frame + until]
    first = int(there.argmax()) if there.any() else len(distances)
    if len(moved) and least < _REACH * size.extent:
        first = min(first, until)
    return first, least


def _around(frames: int, window: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the frames before and after each one."""
    number = np.arange(frames)
    return np.maximum(number - window, 0), np.minimum(number + window, frames - 1)


def _speed(places: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    """Return the mean speed of `[T, ..., 3]` from one frame to another [1/frame]."""
    frames = np.maximum(last - first, 1).reshape(-1, *[1] * (places.ndim - 2))
    return np.linalg.norm(places[last] - places[first], axis=-1) / frames


def runs(labels: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return where each run of equal labels begins and ends."""
    cuts = (np.flatnonzero(np.diff(labels)) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, len(labels)], strict=True))


def _without_short(labels: NDArray[np.int64], shortest: int) -> NDArray[np.int64]:
    """Return labels whose short runs, the shortest first, have the label before them."""
    labels = labels.copy()
    while True:
        every = runs(labels)
        length, first, end = min((end - first, first, end) for first, end in every)
        if length >= shortest or len(every) == 1:
            return labels
        labels[first:end] = labels[first - 1] if first else labels[end]
