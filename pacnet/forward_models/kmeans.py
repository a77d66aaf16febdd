"""Clusters of points by k-means.

Sources: Lloyd (1982); Arthur & Vassilvitskii (2007), k-means++, for where it starts.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

_MAX_ITERATIONS = 100


class Clusters(NamedTuple):
    """What `kmeans` found in T points."""

    centroids: Tensor
    """`[C, D]`."""
    assignment: Tensor
    """The nearest centroid of each point, int64 `[T]`."""
    distortion: float
    """Root mean square distance of a point from its centroid."""
    iterations: int
    """Until no point changed its cluster, or the limit."""


def nearest(points: Tensor, centroids: Tensor) -> Tensor:
    """The nearest (Euclidean) centroid `[C, D]` of each point `[T, D]`, int64 `[T]`.

    Of exactly equal ones the first.
    """
    return _distances(points, centroids).argmin(dim=1)


def kmeans(points: Tensor, clusters: int, generator: torch.Generator) -> Clusters:
    """Groups points so that each is near the mean of its group.

    Args:
        points: float64 on the CPU, `[T, D]`.
        clusters: number C of groups.
        generator: draws the first centroids among the points.

    Raises:
        ValueError: fewer different points than clusters.
    """
    different = len(points.unique(dim=0))
    if different < clusters:
        raise ValueError(
            f"expected at least as many different states as clusters, {clusters}, got {different}"
        )
    centroids = _far_apart(points, clusters, generator)
    assignment, iterations = nearest(points, centroids), 0
    while iterations < _MAX_ITERATIONS:
        iterations += 1
        centroids, before = _means(points, assignment, centroids), assignment
        assignment = nearest(points, centroids)
        if torch.equal(assignment, before):
            break
    apart = (points - centroids[assignment]).square().sum(dim=1)
    return Clusters(centroids, assignment, float(apart.mean().sqrt()), iterations)


def _far_apart(points: Tensor, clusters: int, generator: torch.Generator) -> Tensor:
    """k-means++: each next point with probability ∝ its squared distance to those drawn before."""
    rows = torch.randint(len(points), (1,), generator=generator)
    squared = (points - points[rows]).square().sum(dim=1)  # [T], to the nearest one drawn
    for _ in range(clusters - 1):
        row = torch.multinomial(squared, 1, generator=generator)
        rows = torch.cat([rows, row])
        squared = squared.minimum((points - points[row]).square().sum(dim=1))
    return points[rows]


def _means(points: Tensor, assignment: Tensor, centroids: Tensor) -> Tensor:
    """The mean of each cluster; one without points stays where it was."""
    sums = torch.zeros_like(centroids).index_add_(0, assignment, points)
    sizes = assignment.bincount(minlength=len(centroids))[:, None]
    return (sums / sizes.clamp(min=1)).where(sizes > 0, centroids)


def _distances(points: Tensor, centroids: Tensor) -> Tensor:
    """`[T, C]`, by differences: through a matrix product equal distances would come out unequal."""
    return torch.cdist(points, centroids, compute_mode="donot_use_mm_for_euclid_dist")
