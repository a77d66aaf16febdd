"""K-means: the means of a stream, in batch and online."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

Array = NDArray[np.float64]

_PASSES = 20
_MOST = 6_000  # frames; of more, every n-th is clustered


def batch_means(frames: Array, count: int, rng: np.random.Generator) -> Array:
    """Return the means `[K, D]` of k-means++ and Lloyd's algorithm."""
    some = frames[:: 1 + len(frames) // _MOST]
    # `seed` is the name of `rng` before scipy 1.15, which later releases take too.
    return kmeans2(some, min(count, len(some)), iter=_PASSES, minit="++", seed=rng)[0]


def online_means(frames: Array, count: int) -> Array:
    """Return the means of MacQueen's k-means: the first frames, each moved by those it wins."""
    means, won = frames[:count].copy(), np.ones(min(count, len(frames)))
    for frame in frames[count:]:
        winner = np.square(means - frame).sum(axis=1).argmin()
        won[winner] += 1
        means[winner] += (frame - means[winner]) / won[winner]
    return means


def nearest_frames(frames: Array, means: Array) -> NDArray[np.int64]:
    """Return the numbers of the frames that are nearest to the means, ascending, at most K."""
    nearest = [np.square(frames - mean).sum(axis=1).argmin() for mean in means]
    return np.unique(nearest)
