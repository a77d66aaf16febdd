"""Targets that lie some steps ahead of the percept that they go with."""

from __future__ import annotations

import torch
from torch import Tensor

from pacnet.core.validation import is_integer


def targets_ahead(states: Tensor, steps: int) -> Tensor:
    """The state that each sample of an episode is on its way to.

    Args:
        states: what the targets are made of, `[T, A]`, in order of time within one episode.
        steps: how far ahead, ≥ 0 samples.

    Returns:
        Targets `[T, A]`: the state `steps` samples later; near the end, the last one.

    Raises:
        ValueError: states that are no tensor `[T, A]`, or steps that are no integer ≥ 0.
    """
    if not isinstance(states, Tensor) or states.dim() != 2:
        got = list(states.shape) if isinstance(states, Tensor) else type(states).__name__
        raise ValueError(f"expected states as a tensor of shape [T, A], got {got}")
    if not is_integer(steps, 0):
        raise ValueError(f"expected steps as an integer ≥ 0, got {steps!r}")
    later = torch.arange(len(states), device=states.device) + steps
    return states[later.clamp(max=max(len(states) - 1, 0))]
