"""Saving and loading a model that is one config and its tensors, with its kind in the config."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint

_KIND = "model"  # the field of the config document that names the class

_FLOATS = (torch.float16, torch.bfloat16, torch.float32, torch.float64)  # that a model may be in

_Config = TypeVar("_Config")


def save_model(model: nn.Module, fields: Mapping[str, Any], folder: str | Path) -> None:
    """Writes `config.json` and `model.safetensors`; a kill leaves the old or the new ones.

    Args:
        model: whose state_dict is finite.
        fields: of its config, of what JSON can hold.
        folder: made if it is missing; a checkpoint in it is replaced, other files stay.

    Raises:
        ValueError: a tensor that is not finite; nothing has been written.
    """
    save_tensors(model, fields, model.state_dict(), folder)


def save_tensors(
    model: nn.Module, fields: Mapping[str, Any], tensors: Mapping[str, Tensor], folder: str | Path
) -> None:
    """`save_model` of a `state_dict` that was taken before."""
    check_finite(tensors)
    write_checkpoint(folder, {_KIND: type(model).__name__, **fields}, tensors)


def read_model(folder: str | Path, kind: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Reads the config's fields and the tensors of a model of the named class.

    Raises:
        FileNotFoundError: no checkpoint there.
        ValueError: a damaged file, an unknown version, or the checkpoint of something else.
    """
    fields, tensors = read_checkpoint(folder)
    found = fields.pop(_KIND, None)
    if found != kind:
        other = "something else" if found is None else repr(found)
        raise ValueError(f"expected a checkpoint of {kind} in '{folder}', got one of {other}")
    return fields, tensors


def rebuild_config(kind: type[_Config], fields: dict[str, Any]) -> _Config:
    """The config dataclass of what `dataclasses.asdict` gave, after JSON.

    Raises:
        ValueError: a field is missing, unknown or out of range.
    """
    try:
        return kind(**fields)
    except (TypeError, OverflowError) as error:
        raise ValueError(
            f"expected the fields of {kind.__name__}, got {fields}: {error}"
        ) from error


def load_tensors(model: nn.Module, tensors: dict[str, Tensor], like: str) -> None:
    """Puts a checkpoint's tensors in the place of the model's own; arguments: `check_tensors`.

    Raises:
        ValueError: as `check_tensors`.
    """
    check_tensors(model, tensors, like)
    model.load_state_dict(tensors)


def check_tensors(model: nn.Module, tensors: dict[str, Tensor], like: str) -> None:
    """Checks that a checkpoint's tensors can take the place of the model's own.

    Args:
        model: takes the float type of the tensor `like` before anything is compared; it may be on
            the meta device.
        tensors: by name, as `read_model` gave them.
        like: name of the tensor whose dtype is the model's.

    Raises:
        ValueError: a missing, extra or misshapen tensor, one of another dtype, or not finite.
    """
    kind = type(model).__name__
    check_names(kind, model.state_dict(), tensors)
    if tensors[like].dtype in _FLOATS:
        model.to(tensors[like].dtype)
    for name, tensor in model.state_dict().items():
        wanted, got = (tensor.dtype, tensor.shape), (tensors[name].dtype, tensors[name].shape)
        if wanted != got:
            raise ValueError(
                f"expected {name} of {kind} as {wanted[0]} {list(wanted[1])}, "
                f"got {got[0]} {list(got[1])}"
            )
    check_finite(tensors)


def check_names(kind: str, expected: Iterable[str], got: Iterable[str]) -> None:
    """Raises a ValueError unless the tensors of a model of this kind are named alike."""
    missing, extra = set(expected) - set(got), set(got) - set(expected)
    if missing or extra:
        raise ValueError(
            f"expected the tensors of {kind}, "
            f"got {sorted(missing) or 'none'} missing, {sorted(extra) or 'none'} extra"
        )


def check_finite(tensors: Mapping[str, Tensor]) -> None:
    """Raises a ValueError that names the first tensor with NaN or infinity in it."""
    for name, tensor in tensors.items():
        if not bool(torch.isfinite(tensor).all()):
            raise ValueError(f"expected finite {name}, got NaN or infinity")
