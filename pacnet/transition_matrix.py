"""The paper's own forward model: how often each action led from one kind of state to another.

Source: Maistros, Marom & Hayes (2001), Experiment 2: the robot "collects information about
state-transitions. The transition matrix is then stored and used later as a forward model." The
paper does not say what its states and actions are; here they are clusters found by k-means
(Lloyd 1982, started by k-means++, Arthur & Vassilvitskii 2007) and the candidate actions.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from pacnet.candidates import (
    Outcomes,
    check_candidate_config,
    check_equally_many,
    command,
    select,
)
from pacnet.fitting import check_transitions
from pacnet.forward_model import Command, Selection
from pacnet.interrupts import interrupts_held_back
from pacnet.kmeans import kmeans, nearest
from pacnet.model_checkpoint import load_tensors, read_model, rebuild_config, save_model
from pacnet.validation import check_fields, check_rows, is_integer


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


class TransitionMatrix(nn.Module):
    """Predicts the expected next cluster; chooses the action that comes nearest to a target.

    The prediction for candidate k in cluster c is Σ p(c'|c, k) · centroid(c'), compared with the
    target as it is. The alternative, to choose by the probability of the target's own cluster,
    is not taken: from a few thousand transitions over 60 clusters nearly all of them are 0.

    A pair of cluster and action that was never tried has no prediction and is not chosen; where
    fewer than two candidates were tried the model abstains. Untaught, it abstains everywhere.

    Args:
        config: see `TransitionMatrixConfig`.
    """

    candidates: Tensor  # [K, U]
    centroids: Tensor  # [C, S]
    counts: Tensor  # int64 [C, K, C]: from cluster, by action, to cluster

    def __init__(self, config: TransitionMatrixConfig) -> None:
        super().__init__()
        self.config = config
        clusters, actions = config.clusters, len(config.candidates)
        self.register_buffer("candidates", torch.tensor(config.candidates), persistent=False)
        self.register_buffer("centroids", torch.zeros(clusters, config.state_dimensions))
        counts = torch.zeros(clusters, actions, clusters, dtype=torch.int64)
        self.register_buffer("counts", counts)

    @property
    def action_dimensions(self) -> int:
        """Length U of an action."""
        return self.config.action_dimensions

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
        return self._expected(clusters, nearest(actions, self.candidates)).states

    @torch.no_grad()
    def outcomes(self, states: Tensor, candidates: Tensor) -> Outcomes:
        """Where each candidate `[K, U]` leads from each state `[B, S]`, if it was tried there.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite.
        """
        check_rows("candidates", candidates, self.config.action_dimensions, self.candidates)
        bins = nearest(candidates, self.candidates)
        return self._expected(self(states)[:, None], bins)

    def select(self, state: Tensor, target: Tensor, candidates: Tensor | None = None) -> Selection:
        """Chooses the candidate whose expected state is nearest (Euclidean) to the target.

        Of exactly equal ones the first; what was never tried in the state's cluster costs
        infinity. It abstains where fewer than two candidates were tried, or the spread of the
        expected states is under `config.abstain_below`.

        Args:
            state: `[S]`.
            target: `[S]`.
            candidates: `[K, U]`; the config's if left out. Others count as the nearest of those.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, or not finite.
        """
        return select(self, state, target, candidates)

    def command(self, states: Tensor, targets: Tensor) -> Command:
        """`select` among the config's candidates for each state `[B, S]` and target `[B, S]`.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite;
                unequal numbers of rows.
        """
        return command(self, states, targets)

    def reset(self) -> None:
        """Does nothing: no episode leaves a trace."""

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
        with interrupts_held_back():
            self.centroids.copy_(found.centroids)
            self.counts.copy_(counts)
        tried = (counts.sum(dim=2) > 0).double().mean()
        return MatrixFitReport(found.iterations, found.distortion, float(tried))

    def save_pretrained(self, folder: str | Path) -> None:
        """Writes `config.json` and `model.safetensors`; a kill leaves the old or the new ones.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: a centroid is not finite; nothing has been written.
        """
        save_model(self, asdict(self.config), folder)

    @classmethod
    def from_pretrained(cls, folder: str | Path) -> TransitionMatrix:
        """Loads what `save_pretrained` wrote, on the CPU.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of something else, or a
                missing, extra or misshapen tensor, one of another dtype, not finite, or negative
                counts.
        """
        fields, tensors = read_model(folder, "TransitionMatrix")
        model = cls(rebuild_config(TransitionMatrixConfig, fields))
        load_tensors(model, tensors, like="centroids")
        if bool((model.counts < 0).any()):
            raise ValueError(f"expected counts ≥ 0 in '{folder}', got {int(model.counts.min())}")
        return model

    def _count(self, before: Tensor, actions: Tensor, after: Tensor) -> Tensor:
        """How often each cluster was left by each action for each cluster, `[C, K, C]`."""
        shape = self.counts.shape
        cell = (before * shape[1] + actions) * shape[2] + after  # [T]
        return cell.bincount(minlength=shape.numel()).reshape(shape)

    def _expected(self, clusters: Tensor, actions: Tensor) -> Outcomes:
        """Of clusters and numbers of actions, which broadcast against one another."""
        counts = self.counts[clusters, actions]  # [..., C]
        known = counts.sum(dim=-1) > 0
        shares = self._shares(counts)
        matrix = self._shares(self.counts.transpose(0, 1)[actions])  # [..., C, C]
        # Where the action was never tried nothing is known: what has come there stays.
        untried = matrix.isnan().any(dim=-1, keepdim=True)
        stay = torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
        matrix = torch.where(untried, stay, matrix)
        for _ in range(self.config.steps - 1):
            shares = (shares[..., None, :] @ matrix).squeeze(-2)
        return Outcomes(shares @ self.centroids, known)

    def _shares(self, counts: Tensor) -> Tensor:
        """Probabilities from counts, along the last dimension; NaN where there are none."""
        counts = counts.to(self.centroids.dtype)
        return counts / counts.sum(dim=-1, keepdim=True)
