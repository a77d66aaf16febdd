"""Clusters of points by k-means.

Sources: Lloyd (1982); k-means++ for the first centroids, Arthur & Vassilvitskii (2007). It is our
own so that it draws from a torch generator and needs nothing but torch.
"""

from __future__ import annotations

import torch
from torch import Tensor

_MAX_ITERATIONS = 100


def nearest(points: Tensor, centroids: Tensor) -> Tensor:
    """Return the index of the centroid `[C, D]` nearest to each point `[T, D]`, int64 `[T]`.

    Distances are Euclidean; ties go to the lowest index.
    """
    # By differences, because a matrix product would round equal distances differently.
    mode = "donot_use_mm_for_euclid_dist"
    return torch.cdist(points, centroids, compute_mode=mode).argmin(dim=1)


def kmeans(points: Tensor, clusters: int, generator: torch.Generator) -> tuple[Tensor, int]:
    """Return the centroids `[C, D]` of clusters of points `[T, D]`, float64 on the CPU.

    Returns:
        The centroids, and the number of iterations until no point changed its cluster, at most 100.

    Raises:
        ValueError: fewer different points than clusters.
    """
    different = len(points.unique(dim=0))
    if different < clusters:
        raise ValueError(
            f"expected at least as many different states as clusters, {clusters}, got {different}"
        )
    centroids = _draw_centroids(points, clusters, generator)
    assignment, iterations = nearest(points, centroids), 0
    while iterations < _MAX_ITERATIONS:
        iterations += 1
        centroids, before = _means(points, assignment, centroids), assignment
        assignment = nearest(points, centroids)
        if torch.equal(assignment, before):
            break
    return centroids, iterations


def _draw_centroids(points: Tensor, clusters: int, generator: torch.Generator) -> Tensor:
    """Draw points with probability ∝ the squared distance to the nearest one drawn before."""
    rows = torch.randint(len(points), (1,), generator=generator)
    squared = (points - points[rows]).square().sum(dim=1)  # [T]
    for _ in range(clusters - 1):
        row = torch.multinomial(squared, 1, generator=generator)
        rows = torch.cat([rows, row])
        squared = squared.minimum((points - points[row]).square().sum(dim=1))
    return points[rows]


def _means(points: Tensor, assignment: Tensor, centroids: Tensor) -> Tensor:
    """Return the mean of each cluster; a cluster without points keeps its centroid."""
    sums = torch.zeros_like(centroids).index_add_(0, assignment, points)
    sizes = assignment.bincount(minlength=len(centroids))[:, None]
    return (sums / sizes.clamp(min=1)).where(sizes > 0, centroids)
