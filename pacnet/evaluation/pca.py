"""Principal components of percepts: the two axes on which the paper draws percepts and map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pacnet.evaluation.arrays import finite_array


@dataclass(frozen=True, eq=False)
class PrincipalComponents:
    """Orthogonal directions of largest variance, by singular value decomposition in float64.

    Attributes:
        mean: mean of the scaled percepts `[D]`.
        scale: factor by which each dimension is multiplied first `[D]` [1/unit of that dimension].
        components: directions of length 1, the largest variance first `[D, D]`. The largest loading
            of each (the first of equals) is positive, so that a refit is not mirrored.
        explained_variance_ratio: share of the variance along each direction `[D]`; zeros if the
            percepts do not vary.
    """

    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    components: NDArray[np.float64]
    explained_variance_ratio: NDArray[np.float64]

    @classmethod
    def fit(cls, percepts: ArrayLike, scale: ArrayLike | None = None) -> PrincipalComponents:
        """Fit the principal components of percepts.

        Args:
            percepts: to fit `[T ≥ 1, D ≥ 2]`.
            scale: positive factor on each dimension `[D]`, such as the map's; default ones.

        Raises:
            ValueError: percepts or a scale of another shape, not finite, or a scale that is not
                positive.
        """
        samples = finite_array("percepts", percepts, ("T", "D"))
        if len(samples) == 0 or samples.shape[1] < 2:
            raise ValueError(f"expected percepts [T ≥ 1, D ≥ 2], got {samples.shape}")
        dimensions = (samples.shape[1],)
        factors = np.ones(dimensions) if scale is None else finite_array("scale", scale, dimensions)
        if (factors <= 0).any():
            raise ValueError(f"expected scale > 0 in each dimension, got {scale}")
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
        """Return the coordinates of percepts, or of a map's nodes, on the first two components.

        Args:
            percepts: in the units of those fitted, not scaled `[T, D]`; T may be 0.

        Returns:
            Coordinates `[T, 2]`.

        Raises:
            ValueError: percepts that are not finite numbers `[T, D]`.
        """
        samples = finite_array("percepts", percepts, ("T", len(self.mean)))
        return (samples * self.scale - self.mean) @ self.components[:2].T

    def variance(self, k: int) -> float:
        """Return the share of the variance on the first `k` components, from 0 to 1.

        Raises:
            ValueError: a `k` outside 1 to D.
        """
        if not 1 <= k <= len(self.mean):
            raise ValueError(f"expected k from 1 to {len(self.mean)}, got {k}")
        return float(self.explained_variance_ratio[:k].sum())
