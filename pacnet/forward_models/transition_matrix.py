"""The paper's own forward model: counts how often an action led from one cluster to another.

Source: Maistros, Marom & Hayes (2001), Experiment 2: the robot "collects information about
state-transitions. The transition matrix is then stored and used later as a forward model." The
paper does not define its states and actions; here they are clusters found by k-means and the
candidate actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from pacnet.core.interrupts import defer_sigint
from pacnet.core.validation import check_rows
from pacnet.forward_models.candidates import CandidateModel
from pacnet.forward_models.config import TransitionMatrixConfig
from pacnet.forward_models.kmeans import kmeans, nearest


class MatrixFitReport(NamedTuple):
    """How a fit of a `TransitionMatrix` went."""

    iterations: int
    """Number of iterations of k-means."""
    distortion: float
    """Root mean square distance of a state from the centroid of its cluster."""
    tried: float
    """Share of the C × K pairs of cluster and action with at least one transition."""


class TransitionMatrix(CandidateModel):
    """Predicts the expected next cluster; chooses the action that comes nearest to a target.

    The prediction for candidate k in cluster c is Σ p(c'|c, k) · centroid(c'), compared with the
    target itself. Choosing by the probability of the target's cluster instead would need far more
    data: with a few thousand transitions over 60 clusters nearly all of these probabilities are 0.

    A pair of cluster and action without transitions has no prediction and is not chosen; with fewer
    than two predictions the model abstains. Before `fit` it always abstains.

    Args:
        config: see `TransitionMatrixConfig`.
    """

    config_type = TransitionMatrixConfig
    float_tensor = "centroids"

    centroids: Tensor  # [C, S]
    counts: Tensor  # int64 [C, K, C]: from cluster, by action, to cluster

    def __init__(self, config: TransitionMatrixConfig) -> None:
        super().__init__(config)
        clusters, actions = config.clusters, len(config.candidates)
        self.register_buffer("centroids", torch.zeros(clusters, config.state_dimensions))
        counts = torch.zeros(clusters, actions, clusters, dtype=torch.int64)
        self.register_buffer("counts", counts)

    def forward(self, states: Tensor) -> Tensor:
        """Return the cluster of each state `[B, S]`, int64 `[B]`; ties go to the lowest index.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite.
        """
        check_rows("states", states, self.config.state_dimensions, self.candidates)
        return nearest(states, self.centroids)

    @torch.no_grad()
    def predict(self, states: Tensor, actions: Tensor) -> Tensor:
        """Predict the states `[B, S]` after `config.steps` time steps of actions `[B, U]`.

        A row without transitions to predict from is NaN.

        Raises:
            ValueError: as `command`.
        """
        self._check(states=states, actions=actions)
        return self._expect(nearest(states, self.centroids), nearest(actions, self.candidates))

    def outcomes(self, states: Tensor, candidates: Tensor) -> Tensor:
        """Predict the states `[B, K, S]` after each candidate, see `CandidateModel`.

        Candidates other than the config's count as the nearest of those.
        """
        bins = nearest(candidates, self.candidates)
        return self._expect(nearest(states, self.centroids)[:, None], bins)

    def check_values(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError if a count is negative."""
        if bool((tensors["counts"] < 0).any()):
            raise ValueError(f"expected counts ≥ 0, got {int(tensors['counts'].min())}")

    @torch.no_grad()
    def fit(
        self, states: Tensor, actions: Tensor, next_states: Tensor, *, seed: int
    ) -> MatrixFitReport:
        """Learn from transitions, in eval mode too; an earlier fit is replaced.

        The fit runs on the CPU in float64; the same seed gives the same bytes on every device.

        Args:
            states: `[T, S]`.
            actions: `[T, U]`.
            next_states: `[T, S]`, one time step later.
            seed: of the first centroids.

        Raises:
            ValueError: fewer different states than clusters, wrong shape, dtype or device, not
                finite, or unequal numbers of rows; nothing has been learned then.
        """
        self._check(states=states, actions=actions, next_states=next_states)
        before, actions, after = (rows.double().cpu() for rows in (states, actions, next_states))
        generator = torch.Generator().manual_seed(seed)
        centroids, iterations = kmeans(before, self.config.clusters, generator)
        candidates = torch.tensor(self.config.candidates, dtype=torch.float64)
        start, end = nearest(before, centroids), nearest(after, centroids)
        shape = self.counts.shape
        cells = (start * shape[1] + nearest(actions, candidates)) * shape[2] + end  # [T]
        counts = cells.bincount(minlength=shape.numel()).reshape(shape)
        with defer_sigint():
            self.load_state_dict({"centroids": centroids, "counts": counts})
        squared = (before - centroids[start]).square().sum(dim=1)
        tried = (counts.sum(dim=2) > 0).double().mean()
        return MatrixFitReport(iterations, float(squared.mean().sqrt()), float(tried))

    def _expect(self, clusters: Tensor, actions: Tensor) -> Tensor:
        """Return the expected states of clusters and actions, which broadcast; NaN if unknown."""
        shares = self._probabilities(self.counts[clusters, actions])  # [..., C]
        matrix = self._probabilities(self.counts.transpose(0, 1)[actions])  # [..., C, C]
        # An action that was never tried in a cluster is taken to keep the state there.
        untried = matrix.isnan().any(dim=-1, keepdim=True)
        stay = torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
        matrix = torch.where(untried, stay, matrix)
        for _ in range(self.config.steps - 1):
            shares = (shares[..., None, :] @ matrix).squeeze(-2)
        return shares @ self.centroids

    def _probabilities(self, counts: Tensor) -> Tensor:
        """Divide counts by their sum along the last dimension; NaN if all are 0."""
        counts = counts.to(self.centroids.dtype)
        return counts / counts.sum(dim=-1, keepdim=True)
