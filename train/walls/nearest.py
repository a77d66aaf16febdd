"""The baseline without a map: the mean target of the nearest of some rows."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from envs.khepera import MAX_WHEEL_SPEED
from envs.wall_behaviours import Wanderer
from pacnet import MLPForwardModel
from train.walls.drivers import Driven, shares


class NearestTargets:
    """Drive to the mean target of the nearest cues; without an action, wander.

    Args:
        cues: Percepts `[N, 6]`.
        targets: Readings some steps after each `[N, 6]`.
        count: Of the nearest cues, N at most.
        forward_model: To act with.
        seed: Of the wandering.

    Raises:
        ValueError: No rows, unequal numbers of them, or a count below 1 or above N.
    """

    def __init__(
        self,
        cues: Tensor,
        targets: Tensor,
        count: int,
        forward_model: MLPForwardModel,
        seed: int,
    ) -> None:
        if len(cues) != len(targets) or not 1 <= count <= len(cues):
            wanted = "expected as many cues as targets and a count of 1 to as many"
            raise ValueError(f"{wanted}, got {len(cues)} cues, {len(targets)} targets, {count}")
        self._cues, self._targets, self._count = cues, targets, count
        self._forward_model = forward_model
        self._wanderer = Wanderer(np.random.default_rng(seed))

    def target(self, percept: Tensor) -> Tensor:
        """Return the mean target `[6]` of the cues nearest to a percept `[6]`."""
        away = (self._cues - percept).square().sum(dim=1)
        return self._targets[away.topk(self._count, largest=False).indices].mean(dim=0)

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        seen = torch.from_numpy(percept)
        action = self._forward_model.command_one(seen, self.target(seen))
        if action is None:
            return Driven(shares(self._wanderer.act(percept)))
        self._wanderer.take_over(MAX_WHEEL_SPEED * action)
        return Driven(action, commanded=True)
