"""The paper's own forward model: how often each action led from one kind of state to another.

Source: Maistros, Marom & Hayes (2001), Experiment 2: the robot "collects information about
state-transitions. The transition matrix is then stored and used later as a forward model." The
paper does not say what its states and actions are; here they are clusters found by k-means
(Lloyd 1982, started by k-means++, Arthur & Vassilvitskii 2007) and the candidate actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from pacnet.core.interrupts import defer_sigint
from pacnet.core.validation import check_fields, check_rows, is_integer
from pacnet.forward_models.candidates import (
    CandidateModel,
    check_candidate_config,
    check_equally_many,
)
from pacnet.forward_models.fitting import check_transitions
from pacnet.forward_models.kmeans import kmeans, nearest


@dataclass(frozen=True)
class TransitionMatrixConfig:
    """Settings of a `TransitionMatrix`.

    Attributes:
        state_dimensions: length S of a state and of a target.
        action_dimensions: length U of an action.
        candidates: the K ≥ 1 actions that `command` chooses from. Every other action counts as
            the nearest of them (Euclidean, of equally near ones the first).
        clusters: number C of clusters of states.
        steps: number of time steps for which an action is held.
        abstain_below: spread of the candidates' predicted states, in the state's unit, under
            which no action is given. A single candidate has no spread: it is given only if this
            is 0.

    Raises:
        ValueError: a field of another type or out of range.
    """

    state_dimensions: int
    action_dimensions: int
    candidates: tuple[tuple[float, ...], ...]
    clusters: int = 60
    steps: int = 1
    abstain_below: float = 0.03

    def __post_init__(self) -> None:
        """Turns sequences (JSON reads lists) into tuples and refuses values without meaning."""
        check_candidate_config(self)
        check_fields(self, {"clusters": (is_integer(self.clusters, 1), "≥ 1")})


class MatrixFitReport(NamedTuple):
    """How a `TransitionMatrix` came about."""

    iterations: int
    """Of k-means, until no state changed its cluster or the limit was reached."""
    distortion: float
    """Root mean square distance of a state from its cluster's centroid."""
    tried: float
    """Share of the C × K pairs of cluster and action with at least one transition."""


class TransitionMatrix(CandidateModel):
    """Predicts the expected next cluster; chooses the action that comes nearest to a target.

    The prediction for candidate k in cluster c is Σ p(c'|c, k) · centroid(c'), compared with the
    target as it is. The alternative, to choose by the probability of the target's own cluster,
    is not taken: from a few thousand transitions over 60 clusters nearly all of them are 0.

    A pair of cluster and action that was never tried has no prediction and is not chosen; where
    fewer than two candidates were tried the model abstains. Untaught, it abstains everywhere.

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
        """The cluster of each state, int64 `[B]`, of equally near ones the first.

        Args:
            states: `[B, S]`.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite.
        """
        check_rows("states", states, self.config.state_dimensions, self.candidates)
        return nearest(states, self.centroids)

    @torch.no_grad()
    def predict(self, states: Tensor, actions: Tensor) -> Tensor:
        """Expected states `[B, S]` after `config.steps` steps; NaN rows where never tried.

        Args:
            states: `[B, S]`.
            actions: `[B, U]`.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite;
                unequal numbers of rows.
        """
        check_rows("actions", actions, self.config.action_dimensions, self.candidates)
        clusters = self(states)
        check_equally_many(states=states, actions=actions)
        return self._expected(clusters, nearest(actions, self.candidates))

    def outcomes(self, states: Tensor, candidates: Tensor) -> Tensor:
        """Expected states `[B, K, S]`, see `CandidateModel`; NaN what was never tried.

        Candidates other than the config's count as the nearest of those.
        """
        bins = nearest(candidates, self.candidates)
        return self._expected(nearest(states, self.centroids)[:, None], bins)

    def check_learned(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError if a count is negative."""
        if bool((tensors["counts"] < 0).any()):
            raise ValueError(f"expected counts ≥ 0, got {int(tensors['counts'].min())}")

    @torch.no_grad()
    def fit(
        self, states: Tensor, actions: Tensor, next_states: Tensor, *, seed: int
    ) -> MatrixFitReport:
        """Learns from transitions, afresh: what was learned before is replaced, in eval mode too.

        It computes on the CPU in float64; the same seed gives the same bytes on every device.

        Args:
            states: `[T, S]`.
            actions: `[T, U]`.
            next_states: `[T, S]`, one time step later.
            seed: draws the first centroids.

        Raises:
            ValueError: fewer different states than clusters, wrong shape, dtype or device, not
                finite, or unequal numbers of rows; nothing has been learned then.
        """
        columns = self.config.state_dimensions, self.config.action_dimensions
        check_transitions(states, actions, next_states, columns, self.candidates)
        before, actions, after = (rows.double().cpu() for rows in (states, actions, next_states))
        generator = torch.Generator().manual_seed(seed)
        found = kmeans(before, self.config.clusters, generator)
        candidates = torch.tensor(self.config.candidates, dtype=torch.float64)
        counts = self._count(
            found.assignment, nearest(actions, candidates), nearest(after, found.centroids)
        )
        with defer_sigint():
            self.load_state_dict({"centroids": found.centroids, "counts": counts})
        tried = (counts.sum(dim=2) > 0).double().mean()
        return MatrixFitReport(found.iterations, found.distortion, float(tried))

    def _count(self, before: Tensor, actions: Tensor, after: Tensor) -> Tensor:
        """How often each cluster was left by each action for each cluster, `[C, K, C]`."""
        shape = self.counts.shape
        cell = (before * shape[1] + actions) * shape[2] + after  # [T]
        return cell.bincount(minlength=shape.numel()).reshape(shape)

    def _expected(self, clusters: Tensor, actions: Tensor) -> Tensor:
        """Expected states of clusters and numbers of actions, which broadcast; NaN if unknown."""
        shares = self._shares(self.counts[clusters, actions])  # [..., C]
        matrix = self._shares(self.counts.transpose(0, 1)[actions])  # [..., C, C]
        # Where the action was never tried nothing is known: what has come there stays.
        untried = matrix.isnan().any(dim=-1, keepdim=True)
        stay = torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
        matrix = torch.where(untried, stay, matrix)
        for _ in range(self.config.steps - 1):
            shares = (shares[..., None, :] @ matrix).squeeze(-2)
        return shares @ self.centroids

    def _shares(self, counts: Tensor) -> Tensor:
        """Probabilities from counts, along the last dimension; NaN where there are none."""
        counts = counts.to(self.centroids.dtype)
        return counts / counts.sum(dim=-1, keepdim=True)
