"""Checks of tensors before they become a module's state.

Tensors of a damaged or edited checkpoint can have the right names and shapes and yet contradict one
another: a target of NaN would reach a motor, an edge would lead to a missing node. They are checked
on every load, before anything is copied, and before a checkpoint is replaced.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple, TypeGuard

import torch
from torch import Tensor, nn

from pacnet.core.growable_rows import GrowableRows, check_storage
from pacnet.core.validation import MAX_VALUE, describe

Tensors = Mapping[str, Tensor]
Checks = dict[str, Tensor | bool]

_FLOATS = (torch.float16, torch.bfloat16, torch.float32, torch.float64)
_EXTRA = "_extra_state"
_FORWARD_MODEL = "forward_model"  # a child that checks its own tensors
_MODELS = {_FORWARD_MODEL, "body"}  # children with a floating-point type of their own


def check_on_load(module: nn.Module) -> None:
    """Let `load_state_dict` call the module's `check_state(tensors)` before anything is copied."""
    module.register_load_state_dict_pre_hook(_check_loaded)


def _check_loaded(module: Any, state_dict: Tensors, prefix: str, *_: object) -> None:
    module.check_state(part_of(state_dict, prefix))  # hooks cannot see whether a load is strict
    for name, buffer in module.named_buffers():
        if not isinstance(module.get_submodule(name.rpartition(".")[0]), GrowableRows):
            check_storage(name, buffer)  # it is copied to


def check_structure(module: nn.Module, tensors: Tensors) -> None:
    """Check names, shapes and types of a module's `state_dict`, and the state of its children.

    Children with a `check_state` of their own check all of their tensors. Those of the forward
    model are left to `check_model`.

    Raises:
        ValueError: a missing, extra or misshapen tensor.
    """
    children: dict[str, Any] = {
        f"{name}.": child
        for name, child in module.named_children()
        if hasattr(child, "check_state") and name != _FORWARD_MODEL
    }
    others = (*children, f"{_FORWARD_MODEL}.")
    own = {name: tensor for name, tensor in tensors.items() if not name.startswith(others)}
    kind = type(module).__name__
    _check_own(kind, dict(_specs(module)), own)
    for prefix, child in children.items():
        child.check_state(part_of(tensors, prefix))
    floats = (t.dtype for n, t in tensors.items() if not _MODELS & {*n.split(".")})
    if len({dtype for dtype in floats if dtype.is_floating_point}) > 1:
        raise ValueError(f"expected floating-point tensors of one type in {kind}, got several")


def _check_own(kind: str, specs: Mapping[str, _Spec], tensors: Tensors) -> None:
    check_names(kind, specs, tensors)
    lengths: dict[str, int] = {}  # of each group
    for name, spec in specs.items():
        tensor = tensors[name]
        if not spec.fits(tensor, lengths.get(spec.group)):
            rows = [lengths.get(spec.group, "rows")] if spec.group else []
            raise ValueError(
                f"expected {name} of {kind} as {'integers' if spec.exact else 'float'} of shape "
                f"{[*rows, *spec.shape]}, got {describe(tensor)}"
            )
        check_storage(name, tensor)
        if spec.group:
            lengths[spec.group] = len(tensor)


def _is_dense(value: object) -> TypeGuard[Tensor]:
    """Return whether a value is a tensor with memory that holds each element."""
    return isinstance(value, Tensor) and value.layout == torch.strided and not value.is_meta


class _Spec(NamedTuple):
    """What a tensor must look like."""

    group: str  # tensors of one group are equally long; "" for one of fixed length
    shape: tuple[int, ...]  # of each row, or of the whole tensor
    exact: torch.dtype | None  # None for any floating-point type

    def fits(self, tensor: object, length: int | None) -> bool:
        """Return whether a tensor looks like this, given the length of its group if it is known."""
        if not _is_dense(tensor) or tensor.dtype not in ((self.exact,) if self.exact else _FLOATS):
            return False
        if not self.group:
            return tensor.shape == self.shape
        return tensor.dim() > 0 and length in (None, len(tensor)) and tensor.shape[1:] == self.shape


def _specs(module: nn.Module, prefix: str = "") -> Iterator[tuple[str, _Spec]]:
    """Yield the name and the spec of each tensor that the module itself checks."""
    if isinstance(module, GrowableRows):
        for name, (shape, dtype, _) in module.columns.items():
            yield prefix + name, _Spec(prefix, shape, None if dtype.is_floating_point else dtype)
        return
    for name, buffer in module._buffers.items():
        if buffer is not None and name not in module._non_persistent_buffers_set:
            exact = None if buffer.is_floating_point() else buffer.dtype
            yield prefix + name, _Spec("", tuple(buffer.shape), exact)
    if type(module).get_extra_state is not nn.Module.get_extra_state:
        yield prefix + _EXTRA, _Spec(prefix + _EXTRA, (), torch.uint8)
    for name, child in module.named_children():
        if name != _FORWARD_MODEL and not hasattr(child, "check_state"):
            yield from _specs(child, f"{prefix}{name}.")


def check_model(model: object, tensors: Tensors, strict: bool) -> None:
    """Check tensors that are to be loaded into a forward model, or into None.

    Raises:
        ValueError: a misshapen tensor, or, if strict, a missing or extra one.
    """
    own = model.state_dict() if isinstance(model, nn.Module) else {}
    if strict:
        check_names("the forward model", own, tensors)
    for name in own.keys() & tensors.keys():
        wanted, got = own[name], tensors[name]
        fits = _is_dense(got) and isinstance(wanted, Tensor) and got.shape == wanted.shape
        if isinstance(wanted, Tensor) and not fits:
            raise ValueError(
                f"expected {name} of the forward model of shape {list(wanted.shape)}, "
                f"got {describe(got)}"
            )
    check_loaded = getattr(model, "check_loaded", None)  # of this library's models
    if callable(check_loaded):
        check_loaded(tensors)


def check_tensors(model: nn.Module, tensors: Tensors, like: str) -> None:
    """Check names, types and shapes of a checkpoint's tensors against a model's own.

    The model, which may be on the meta device, is first cast to the dtype of the tensor `like`.

    Raises:
        ValueError: a missing, extra or misshapen tensor, or one of another dtype.
    """
    kind = type(model).__name__
    check_names(kind, model.state_dict(), tensors)
    if tensors[like].dtype in _FLOATS:
        model.to(tensors[like].dtype)
    for name, own in model.state_dict().items():
        got = tensors[name]
        if (got.dtype, got.shape) != (own.dtype, own.shape):
            raise ValueError(
                f"expected {name} of {kind} as {own.dtype} {list(own.shape)}, got {describe(got)}"
            )


def check_names(kind: str, expected: Iterable[str], got: Iterable[str]) -> None:
    """Raise a ValueError unless the tensors of a model of this kind have the expected names."""
    missing, extra = set(expected) - set(got), set(got) - set(expected)
    if missing or extra:
        raise ValueError(
            f"expected the tensors of {kind}, "
            f"got {sorted(missing) or 'none'} missing, {sorted(extra) or 'none'} extra"
        )


def check_finite(tensors: Tensors, where: str = "") -> None:
    """Raise a ValueError that names the first tensor with NaN or infinity in it."""
    for name, tensor in tensors.items():
        if tensor.dtype in _FLOATS and not bool(torch.isfinite(tensor).all()):
            raise ValueError(f"expected finite {name}{where}, got NaN or infinity")


def check_conditions(checks: Mapping[str, Tensor | bool]) -> None:
    """Raise a ValueError for the first condition that does not hold."""
    for condition, holds in checks.items():
        if not bool(holds):
            raise ValueError(f"expected {condition}, got tensors in which it does not hold")


def part_of(tensors: Tensors, prefix: str) -> dict[str, Tensor]:
    """Return the tensors whose names begin with a prefix, without the prefix."""
    return {name[len(prefix) :]: t for name, t in tensors.items() if name.startswith(prefix)}


def are_bounded(rows: Tensor) -> Tensor:
    """Return whether rows are finite, and small enough for their distances to be finite."""
    # In half precision MAX_VALUE overflows to infinity, so `isfinite` is needed too.
    return (rows.isfinite() & (rows.abs() <= MAX_VALUE)).all()


def within(numbers: Tensor, count: int | Tensor) -> bool:
    """Return whether all numbers are from 0 to below a count, or each to below its own."""
    return bool(((numbers >= 0) & (numbers < count)).all())
