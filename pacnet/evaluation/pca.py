"""Principal components of percepts: the two axes on which the paper draws percepts and map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class PrincipalComponents:
    """Orthogonal directions of largest variance, by singular value decomposition in float64.

    Attributes:
        mean: Mean of the scaled percepts [D].
        scale: Factor on each dimension before anything else, in 1/unit of that dimension [D].
        components: One direction of length 1 a row, the largest variance first [D, D]. The largest
            loading of each (the first of equals) is positive, so that a refit is not mirrored.
        explained_variance_ratio: Share of the variance along each direction [D]; zeros where the
            percepts do not vary.
    """

    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    components: NDArray[np.float64]
    explained_variance_ratio: NDArray[np.float64]

    @classmethod
    def fit(cls, percepts: ArrayLike, scale: ArrayLike | None = None) -> PrincipalComponents:
        """Find the principal components of percepts.

        Args:
            percepts: One percept a row [T, D].
            scale: Positive factor on each dimension [D], as the map's own; ones if left out.

        Raises:
            ValueError: Percepts that are not finite numbers [T >= 1, D >= 2], or a scale that is
                not D positive finite factors.
        """
        samples = _rows(percepts)
        if len(samples) == 0 or samples.shape[1] < 2:
            raise ValueError(f"expected percepts [T ≥ 1, D ≥ 2], got {samples.shape}")
        factors = _factors(scale, samples.shape[1])
        scaled = samples * factors
        mean = scaled.mean(axis=0)
        # Rows of zeros change no direction and complete the basis of fewer samples than dimensions.
        missing = max(samples.shape[1] - len(samples), 0)
        centred = np.pad(scaled - mean, ((0, missing), (0, 0)))
        _, singular, directions = np.linalg.svd(centred, full_matrices=False)
        variance = singular**2
        rounding = samples.size * (np.finfo(np.float64).eps * np.abs(scaled).max()) ** 2
        largest = np.abs(directions).argmax(axis=1)
        signs = np.where(directions[np.arange(len(directions)), largest] < 0, -1.0, 1.0)
        varies = variance.sum() > rounding
        ratio = variance / variance.sum() if varies else np.zeros_like(variance)
        return cls(mean, factors, directions * signs[:, None], ratio)

    def project(self, percepts: ArrayLike) -> NDArray[np.float64]:
        """Coordinates of percepts, or of a map's nodes, on the first two components.

        Args:
            percepts: In the units of those fitted, not scaled [T, D]; T may be 0.

        Returns:
            Coordinates [T, 2].

        Raises:
            ValueError: Percepts that are not finite numbers [T, D].
        """
        samples = _rows(percepts)
        if samples.shape[1] != len(self.mean):
            raise ValueError(f"expected percepts [T, {len(self.mean)}], got {samples.shape}")
        return (samples * self.scale - self.mean) @ self.components[:2].T

    def variance(self, k: int) -> float:
        """Share of the variance on the first `k` components, from 0 to 1.

        Raises:
            ValueError: A `k` outside 1 to D.
        """
        if not 1 <= k <= len(self.mean):
            raise ValueError(f"expected k from 1 to {len(self.mean)}, got {k}")
        return float(self.explained_variance_ratio[:k].sum())


def _rows(percepts: ArrayLike) -> NDArray[np.float64]:
    """Percepts as finite float64 [T, D], or a ValueError."""
    array = np.asarray(percepts)
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        raise ValueError(f"expected percepts as numbers [T, D], got {array.dtype} {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError("expected finite percepts, got NaN or infinity")
    return array.astype(np.float64)


def _factors(scale: ArrayLike | None, dimensions: int) -> NDArray[np.float64]:
    """The scale as float64 [D], ones if none is given, or a ValueError."""
    factors = np.ones(dimensions) if scale is None else np.array(scale, dtype=np.float64)
    if factors.shape != (dimensions,) or not (np.isfinite(factors) & (factors > 0)).all():
        raise ValueError(f"expected scale as {dimensions} positive finite factors, got {scale}")
    return factors
