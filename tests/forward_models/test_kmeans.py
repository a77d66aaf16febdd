"""k-means, against Lloyd's two steps in numpy."""

import numpy as np
import pytest
import torch

from pacnet.forward_models.kmeans import _means, kmeans, nearest


def test_clusters_are_a_fixed_point_of_lloyds_two_steps():
    points = torch.randn(400, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    centroids, iterations = kmeans(points, 7, torch.Generator().manual_seed(0))
    assignment = nearest(points, centroids).numpy()
    distances = np.linalg.norm(points.numpy()[:, None] - centroids.numpy(), axis=2)
    assert assignment.tolist() == distances.argmin(axis=1).tolist()
    for cluster in range(7):
        members = points.numpy()[assignment == cluster]
        np.testing.assert_allclose(centroids[cluster].numpy(), members.mean(axis=0), atol=1e-12)
    assert iterations < 100


@pytest.mark.parametrize("seed", range(5))
def test_well_separated_groups_are_found(seed):
    generator = torch.Generator().manual_seed(seed)
    group = torch.arange(6).repeat_interleave(20)
    noise = torch.rand(120, 1, generator=generator, dtype=torch.float64)
    points = 1000.0 * group[:, None] + noise
    assignment = nearest(points, kmeans(points, 6, generator)[0])
    assert len({*zip(group.tolist(), assignment.tolist(), strict=True)}) == 6


def test_a_cluster_that_loses_all_its_points_stays_where_it_was():
    points, centroids = torch.tensor([[2.0], [4.0]]), torch.tensor([[9.0], [7.0]])
    assert _means(points, torch.tensor([0, 0]), centroids).tolist() == [[3.0], [7.0]]
