"""Copy-on-write learning: learn on a draft of a module, then replace its state at once.

An error or a Ctrl-C while learning leaves the module as it was. A thread that reads meanwhile sees
the state before or the state after, never a mixture.
"""

from __future__ import annotations

import copy
import operator
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from pacnet.core.growable_rows import GrowableRows, check_storage
from pacnet.core.interrupts import defer_sigint

_Module = TypeVar("_Module", bound=nn.Module)
_CACHE = "_cache"  # attribute that holds what a module derived from its own tensors
_NOT_LEARNED = ("_modules", "_parameters", "training", "config", "engine")  # attributes of a module
_version_of = operator.attrgetter("_version")
_SHORT = 1e-4  # [s] after which a thread that learns lets another one run

_switching = threading.Lock()
_usual_interval: list[float] = []  # [s], once for each thread that learns


class Lock:
    """A reentrant lock of a module; a copy of the module gets another one."""

    def __init__(self) -> None:
        self.lock = threading.RLock()  # faster to enter than this object

    def __enter__(self) -> None:
        """Acquire it."""
        self.lock.acquire()

    def __exit__(self, *_: object) -> None:
        """Release it."""
        self.lock.release()

    def __reduce__(self) -> tuple[type[Lock], tuple[()]]:
        """Copy and pickle as a new, released lock."""
        return Lock, ()


def draft_of(module: _Module) -> _Module:
    """Return a copy with tensors of its own; parameters and settings are shared.

    Raises:
        ValueError: the memory of a tensor is gone.
    """
    for name, buffer in module.named_buffers():
        check_storage(name, buffer)
    with torch.inference_mode(False):  # a caller's would make them unchangeable later
        return _copy(module, clone=True)


def snapshot_of(module: _Module) -> _Module:
    """Return a copy with the same tensors, which it keeps when the original replaces its own."""
    return _copy(module, clone=False)


def _copy(module: _Module, *, clone: bool) -> _Module:
    other = copy.copy(module)
    if _CACHE in other.__dict__:
        other.__dict__[_CACHE] = None
    if clone and isinstance(other, GrowableRows):
        other.copy_memory()
    else:
        other._buffers = {
            name: buffer.clone() if clone and buffer is not None else buffer
            for name, buffer in module._buffers.items()
        }
    other._parameters = dict(module._parameters)
    other._modules = {
        name: None if child is None else _copy(child, clone=clone)
        for name, child in module._modules.items()
    }
    return other


def adopt(module: nn.Module, draft: nn.Module) -> None:
    """Replace a module's state by that of a draft, deferring a Ctrl-C.

    Modules stay the same objects, in their present mode and with their present config.
    """
    with defer_sigint():
        _adopt(module, draft)


def _adopt(module: nn.Module, draft: nn.Module) -> None:
    for name, value in draft.__dict__.items():
        if name == "_buffers":
            module._buffers.update(draft._buffers)
        elif name not in _NOT_LEARNED:
            module.__dict__[name] = None if name == _CACHE else value
    for name, child in module._modules.items():
        other = draft._modules[name]
        if child is not None and other is not None:
            _adopt(child, other)


class BufferVersions:
    """A record of buffers, to detect later that one was replaced or changed.

    Args:
        modules: all buffers of these modules and their children.
        single: further buffers, by module and name.

    Raises:
        ValueError: the memory of a buffer is gone.
    """

    def __init__(self, *modules: nn.Module, single: Sequence[tuple[nn.Module, str]] = ()) -> None:
        children = [child for module in modules for child in module.modules()]
        owned = [(child, name) for child in children for name in child._buffers]
        places = []
        for module, name in (*owned, *single):
            buffer = module._buffers[name]
            if buffer is not None:
                places.append((module._buffers, name, check_storage(name, buffer)))
        self._remember(places)

    def _remember(self, places: list[tuple[dict[str, Tensor | None], str, Tensor]]) -> None:
        self._owners = [owner for owner, _, _ in places]
        self._names = [name for _, name, _ in places]
        self._buffers = [buffer for _, _, buffer in places]
        # Torch counts changes in place, but not those of tensors made in inference mode.
        self._counted = [buffer for buffer in self._buffers if not buffer.is_inference()]
        self._addresses = list(map(Tensor.data_ptr, self._buffers))
        self._versions = list(map(_version_of, self._counted))

    def unchanged(self) -> bool:
        """Return whether no buffer was replaced, moved, or changed by a tensor operation."""
        there = map(operator.getitem, self._owners, self._names)
        try:
            return (
                all(map(operator.is_, there, self._buffers))
                and list(map(Tensor.data_ptr, self._buffers)) == self._addresses
                and list(map(_version_of, self._counted)) == self._versions
            )
        except RuntimeError:  # the memory of a tensor is gone
            return False

    def __getstate__(self) -> tuple[list[Any], bool]:
        """Leave out addresses and versions, which differ in a copy."""
        places = list(zip(self._owners, self._names, self._buffers, strict=True))
        return places, self.unchanged()

    def __setstate__(self, state: tuple[list[Any], bool]) -> None:
        """Remember the copy's buffers, which are unchanged if the original's were."""
        places, unchanged = state
        self._remember(places)
        if not unchanged:
            self._addresses = []


@contextmanager
def short_switch_interval() -> Iterator[None]:
    """Let other threads run sooner while this one learns.

    Python switches threads after 5 ms (`sys.setswitchinterval`), which is long for a control loop.
    """
    with _switching:
        _usual_interval.append(_usual_interval[0] if _usual_interval else sys.getswitchinterval())
        sys.setswitchinterval(min(_SHORT, _usual_interval[0]))
    try:
        yield
    finally:
        with _switching:
            usual = _usual_interval.pop()
            if not _usual_interval:
                sys.setswitchinterval(usual)
