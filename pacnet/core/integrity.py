"""What must hold of a module's tensors, whoever made them, before they become its state.

A checkpoint or a `state_dict` can be damaged or edited so that each tensor has the right name and
shape and the whole still means nothing: a target of NaN would reach a motor, an edge could lead to
a node that is not there. Checked on every load, before anything is copied, and before a good
checkpoint is replaced.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import torch
from torch import Tensor, nn

from pacnet.core.growable_rows import GrowableRows, check_storage
from pacnet.core.validation import LARGEST

Tensors = Mapping[str, Tensor]
Checks = dict[str, Tensor | bool]

_EXTRA = "_extra_state"
_MODEL = "forward_model"  # a child of which others check what it is made of


class _Form(NamedTuple):
    rows: str | None  # the rows that it is a column of
    shape: tuple[int, ...]  # of one of them, or of the tensor
    integer: bool


class Checked(Protocol):
    """A module whose state can be checked."""

    def check_state(self, tensors: Tensors) -> None:
        """Raises a ValueError naming the first thing that does not hold of its `state_dict`."""
        ...


def check_on_load(module: nn.Module) -> None:
    """Has `load_state_dict` refuse what does not hold, before anything is changed."""
    module.register_load_state_dict_pre_hook(_check_loaded)


def _check_loaded(module: Any, state_dict: Mapping[str, Tensor], prefix: str, *_: object) -> None:
    module.check_state(part_of(state_dict, prefix))  # torch tells no hook that it is not strict
    for name, buffer in module.named_buffers():
        if not isinstance(module.get_submodule(name.rpartition(".")[0]), GrowableRows):
            check_storage(name, buffer)  # it is copied to


def check_model(model: object, tensors: Tensors, strict: bool) -> None:
    """Refuses what torch would refuse of a forward model when all else has been copied.

    Args:
        model: the forward model, or None.
        tensors: what is to be loaded into it, by name.
        strict: whether no name may be missing or unknown.

    Raises:
        ValueError: naming what is.
    """
    known = model.state_dict() if isinstance(model, nn.Module) else {}
    if strict and known.keys() != tensors.keys():
        raise ValueError(
            f"expected the tensors {sorted(known) or 'none'} of the forward model, "
            f"got {sorted(tensors) or 'none'}"
        )
    for name in known.keys() & tensors.keys():
        own, other = known[name], tensors[name]
        if isinstance(own, Tensor) and not (
            isinstance(other, Tensor)
            and own.shape == other.shape
            and other.layout == own.layout
            and not other.is_meta
        ):
            raise ValueError(
                f"expected {name} of the forward model of shape {list(own.shape)}, got {other}"
            )
    check_values = getattr(model, "check_loaded", None)  # of those that have learned something
    if callable(check_values):
        check_values(tensors)


def check_forms(module: nn.Module, tensors: Tensors) -> None:
    """Checks names, shapes and types of what is to become a module's state.

    Raises:
        ValueError: naming what is missing, unexpected or misshapen.
    """
    forms, kind = _forms_of(module), type(module).__name__
    if forms.keys() != tensors.keys():
        missing, extra = sorted(forms.keys() - tensors), sorted(tensors.keys() - forms)
        raise ValueError(
            f"expected the tensors of {kind}, "
            f"got {missing or 'none'} missing, {extra or 'none'} extra"
        )
    counts: dict[str, int] = {}
    for name, (rows, shape, integer) in forms.items():
        tensor = tensors[name]
        fits = isinstance(tensor, Tensor) and tensor.layout == torch.strided and not tensor.is_meta
        fits = fits and tensor.is_floating_point() != integer
        text = name.endswith(_EXTRA)
        fits = fits and (not integer or tensor.dtype == (torch.uint8 if text else torch.int64))
        own = tuple(tensor.shape) if fits else ()
        if rows is not None and own:
            fits = counts.setdefault(rows, own[0]) == own[0]
            own = own[1:]
        elif rows is not None:
            fits = False
        if not fits or own != shape:
            wanted = [*([counts.get(rows, "rows")] if rows is not None else []), *shape]
            got = f"{tensor.dtype} {list(tensor.shape)}" if isinstance(tensor, Tensor) else tensor
            raise ValueError(
                f"expected {name} of {kind} as {'integers' if integer else 'float'} of shape "
                f"{wanted}, got {got}"
            )
        check_storage(name, tensor)
    if len({t.dtype for name, t in tensors.items() if not forms[name].integer}) > 1:
        raise ValueError(f"expected floating-point tensors of one type in {kind}, got several")


def check_holds(checks: Mapping[str, Tensor | bool]) -> None:
    """Raises a ValueError for the first that does not hold."""
    for name, holds in checks.items():
        if not bool(holds):
            raise ValueError(f"expected {name}, got tensors in which it does not hold")


def part_of(tensors: Tensors, prefix: str) -> dict[str, Tensor]:
    """Those whose names begin with it, without it."""
    return {name[len(prefix) :]: t for name, t in tensors.items() if name.startswith(prefix)}


def _forms_of(module: nn.Module) -> dict[str, _Form]:
    """What a module's `state_dict` is made of; a forward model checks its own."""
    return dict(_walk(module, ""))


def _walk(module: nn.Module, prefix: str) -> Iterator[tuple[str, _Form]]:
    if isinstance(module, GrowableRows):
        for name, column in module.columns.items():
            integer = not column.dtype.is_floating_point
            yield prefix + name, _Form(prefix, column.shape, integer)
        return
    for name, buffer in module._buffers.items():
        if buffer is not None and name not in module._non_persistent_buffers_set:
            form = _Form(None, tuple(buffer.shape), not buffer.is_floating_point())
            yield prefix + name, form
    if type(module).get_extra_state is not nn.Module.get_extra_state:
        yield prefix + _EXTRA, _Form(prefix + _EXTRA, (), True)
    for name, child in module.named_children():
        if name != _MODEL:
            yield from _walk(child, f"{prefix}{name}.")


def distant(rows: Tensor) -> Tensor:
    """Whether rows are finite, and their distances from others would be."""
    return (rows.isfinite() & (rows.abs() <= LARGEST)).all()  # in half precision, that is infinite


def within(numbers: Tensor, count: int | Tensor) -> bool:
    """Whether all numbers are from 0 to below a count, or each to below its own."""
    return bool(((numbers >= 0) & (numbers < count)).all())
