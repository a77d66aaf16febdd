"""Targets that lie some steps ahead of their percepts."""

from __future__ import annotations

import torch
from torch import Tensor

from pacnet.core.validation import is_integer


def targets_ahead(states: Tensor, steps: int) -> Tensor:
    """Return the state `steps` samples after each sample of an episode; near the end, the last.

    Args:
        states: `[T, A]`, in order of time.
        steps: ≥ 0 [samples].

    Raises:
        ValueError: states that are not a tensor `[T, A]`, or steps that are not an integer ≥ 0.
    """
    if not isinstance(states, Tensor) or states.dim() != 2:
        got = list(states.shape) if isinstance(states, Tensor) else type(states).__name__
        raise ValueError(f"expected states as a tensor of shape [T, A], got {got}")
    if not is_integer(steps, 0):
        raise ValueError(f"expected steps as an integer ≥ 0, got {steps!r}")
    later = torch.arange(len(states), device=states.device) + steps
    return states[later.clamp(max=max(len(states) - 1, 0))]
