"""Checks of what a network is given, before anything changes."""

from __future__ import annotations

from collections.abc import Mapping
from operator import index

from torch import Tensor, nn

from pacnet.attention.sofm import HabituatingSOFM
from pacnet.core.growable_rows import check_storage
from pacnet.core.integrity import check_conditions, check_structure, part_of
from pacnet.core.validation import check_bounded, check_rows
from pacnet.network.config import PACNetConfig
from pacnet.schemas.interface import NO_EPISODE, Schemas

FORWARD_MODEL = "forward_model."
"""What the names of the forward model's tensors begin with."""
_LAST_EPISODE = 2**63 - 1  # the largest int64


def check_episode(episode: object, last: Tensor) -> int:
    """Return an episode's number, or raise a ValueError; the last one's may come again."""
    try:
        number = None if isinstance(episode, bool) else index(episode)  # pyright: ignore[reportArgumentType]
    except TypeError:
        number = None
    if number is None:
        raise ValueError(f"expected episode as an int, got {type(episode).__name__}")
    if number > _LAST_EPISODE:
        raise ValueError(f"expected episode ≤ {_LAST_EPISODE}, got {episode}")
    lowest = max(0, int(check_storage("episode", last)))
    if number < lowest:
        raise ValueError(f"expected episode ≥ {lowest}, the last one observed, got {episode}")
    return number


def check_pair(
    sofm: HabituatingSOFM, schemas: Schemas, percepts: Tensor, targets: Tensor
) -> tuple[Tensor, Tensor]:
    """Return normalized percepts `[T, D]` and targets `[T, A]`, or raise a ValueError."""
    percepts = sofm.normalize(percepts)
    wanted = schemas.pool.live("target")  # nothing else is read: another thread may be learning
    if wanted.dim() != 2:
        raise ValueError(f"expected stored targets [rows, A], got {list(wanted.shape)}")
    targets = check_bounded("targets", targets, wanted.shape[1], wanted)
    if len(percepts) != len(targets):
        raise ValueError(
            f"expected one target for each of {len(percepts)} percepts, got {len(targets)}"
        )
    return percepts, targets


def check_states(states: Tensor, percepts: Tensor) -> Tensor:
    """Return states `[T, S]`, one for each percept, or raise a ValueError."""
    columns = states.shape[1] if isinstance(states, Tensor) and states.dim() == 2 else 1
    check_rows("states", states, columns, like=percepts)
    if len(states) != len(percepts):
        raise ValueError(
            f"expected one state for each of {len(percepts)} percepts, got {len(states)}"
        )
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


def check_state(network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """See `PACNet.check_state`."""
    check_structure(network, tensors)
    schemas = network.get_submodule("schemas")
    assert isinstance(schemas, Schemas)
    kept, last = schemas.extent(part_of(tensors, "schemas."))
    nodes = len(tensors["sofm.nodes.prototype"])
    if nodes != kept:
        raise ValueError(f"expected motor schemas for each node, got {kept} for {nodes} nodes")
    check_conditions(
        {"an episode ≥ −1, the last of all": tensors["episode"] >= max(NO_EPISODE, last)}
    )
