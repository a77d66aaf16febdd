"""Checks of a network's arguments, before anything changes."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from pacnet.attention.sofm import HabituatingSOFM
from pacnet.core.validation import check_bounded, check_rows, check_same_length
from pacnet.forward_models.protocol import ForwardModel
from pacnet.network.config import PACNetConfig
from pacnet.schemas.interface import Schemas

FORWARD_MODEL = "forward_model."
"""What the names of the forward model's tensors begin with."""


def check_model_type(model: object) -> None:
    """Raise a ValueError unless this is a `ForwardModel` or None."""
    if model is not None and not isinstance(model, ForwardModel):
        got = type(model).__name__
        raise ValueError(f"expected forward_model as a ForwardModel or None, got {got}")


def check_pair(
    sofm: HabituatingSOFM, schemas: Schemas, percepts: Tensor, targets: Tensor
) -> tuple[Tensor, Tensor]:
    """Return normalized percepts `[T, D]` and targets `[T, A]`, or raise a ValueError."""
    percepts = sofm.normalize(percepts)
    wanted = schemas.pool.live("target")  # nothing else is read: another thread may be learning
    if wanted.dim() != 2:
        raise ValueError(f"expected stored targets [rows, A], got {list(wanted.shape)}")
    targets = check_bounded("targets", targets, wanted.shape[1], wanted)
    check_same_length(percepts=percepts, targets=targets)
    return percepts, targets


def check_states(states: Tensor, percepts: Tensor) -> Tensor:
    """Return states `[T, S]`, one for each percept, or raise a ValueError."""
    columns = states.shape[1] if isinstance(states, Tensor) and states.dim() == 2 else 1
    check_rows("states", states, columns, like=percepts)
    check_same_length(percepts=percepts, states=states)
    return states


def check_dimensions(config: PACNetConfig, tensors: Mapping[str, Tensor], prefix: str) -> None:
    """Raise a ValueError unless percepts and targets are as long as the config says."""
    widths = {
        "sofm.nodes.prototype": config.attention.dimensions,
        "schemas.pool.cue": config.schemas.percept_dimensions,
        "schemas.pool.target": config.schemas.target_dimensions,
    }
    for name, width in widths.items():
        tensor = tensors.get(prefix + name)
        if tensor is None or tuple(tensor.shape[1:]) != (width,):
            got = "none" if tensor is None else list(tensor.shape)
            raise ValueError(f"expected {prefix}{name} of shape [rows, {width}], got {got}")
