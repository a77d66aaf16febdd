"""Learning on a draft: whoever acts meanwhile acts on what was known before, or all that is after.

What is learned goes into a copy of a module's state, and takes its place at the end, at once. So a
refusal, an error or a Ctrl-C on the way leaves everything as it was, and a thread that reads sees
no half of it.
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
_CACHE = "_cache"  # attribute that holds what was worked out from a module's own tensors
_NOT_LEARNED = ("_modules", "_parameters", "training", "config", "engine")  # attributes of a module
_version_of = operator.attrgetter("_version")
_TURN = 1e-4  # [s] that a thread may go on while another waits


class Lock:
    """A reentrant lock of a module's own: a copy of the module gets another one.

    Attributes:
        lock: the lock itself, which is faster.
    """

    def __init__(self) -> None:
        self.lock = threading.RLock()

    def __enter__(self) -> None:
        """Waits for it."""
        self.lock.acquire()

    def __exit__(self, *_: object) -> None:
        """Lets others have it."""
        self.lock.release()

    def __reduce__(self) -> tuple[type[Lock], tuple[()]]:
        """Copies and pickles do not wait for this one."""
        return Lock, ()


def draft_of(module: _Module) -> _Module:
    """A module with tensors of its own and the same values; parameters and settings are shared.

    Raises:
        ValueError: a tensor that is no longer all in memory.
    """
    for name, buffer in module.named_buffers():
        check_storage(name, buffer)
    # Made inside a caller's inference mode they would be tensors nobody can update later.
    with torch.inference_mode(False):
        return _twin(module, clone=True)


def frozen(module: _Module) -> _Module:
    """A module that shares its tensors, and keeps them when the original gets others."""
    return _twin(module, clone=False)


def _twin(module: _Module, *, clone: bool) -> _Module:
    twin = copy.copy(module)
    if _CACHE in twin.__dict__:
        twin.__dict__[_CACHE] = None
    if clone and isinstance(twin, GrowableRows):
        twin.copy_memory()
    else:
        twin._buffers = {
            name: buffer.clone() if clone and buffer is not None else buffer
            for name, buffer in module._buffers.items()
        }
    twin._parameters = dict(module._parameters)
    twin._modules = {
        name: None if child is None else _twin(child, clone=clone)
        for name, child in module._modules.items()
    }
    return twin


def adopt(module: nn.Module, draft: nn.Module) -> None:
    """Puts what a draft has learned in the place of what the module knew.

    The modules stay the same, and in the mode and with the config that they have got meanwhile.
    A Ctrl-C waits.
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


class Tensors:
    """Buffers, to see later whether they are still the same ones, unchanged.

    Args:
        modules: whose buffers, of all their parts.
        of: single ones, by module and name.
    """

    def __init__(self, *modules: nn.Module, of: Sequence[tuple[nn.Module, str]] = ()) -> None:
        for module in modules:
            for name, buffer in module.named_buffers():
                check_storage(name, buffer)
        places = [
            (child._buffers, name, buffer)
            for module in modules
            for child in module.modules()
            for name, buffer in child._buffers.items()
            if buffer is not None
        ]
        for module, name in of:
            buffer = module.get_buffer(name)
            places.append((module._buffers, name, check_storage(name, buffer)))
        self._look_at(places)

    def _look_at(self, places: list[tuple[dict[str, Tensor | None], str, Tensor]]) -> None:
        self._owners = [owner for owner, _, _ in places]
        self._names = [name for _, name, _ in places]
        self._buffers = [buffer for _, _, buffer in places]
        # How often tensor operations changed one in place is not counted in inference mode.
        self._counted = [buffer for buffer in self._buffers if not buffer.is_inference()]
        self._addresses = list(map(Tensor.data_ptr, self._buffers))
        self._versions = list(map(_version_of, self._counted))

    def are_current(self) -> bool:
        """Whether none was replaced, moved, or changed by a tensor operation."""
        there = map(operator.getitem, self._owners, self._names)
        try:
            return (
                all(map(operator.is_, there, self._buffers))
                and list(map(Tensor.data_ptr, self._buffers)) == self._addresses
                and list(map(_version_of, self._counted)) == self._versions
            )
        except RuntimeError:  # of a tensor that is no longer in memory
            return False

    def __getstate__(self) -> tuple[list[Any], bool]:
        """A copy's tensors lie elsewhere, and count their changes anew."""
        places = list(zip(self._owners, self._names, self._buffers, strict=True))
        return places, self.are_current()

    def __setstate__(self, state: tuple[list[Any], bool]) -> None:
        """They are unchanged, if the original's were."""
        places, current = state
        self._look_at(places)
        if not current:
            self._addresses = []


@contextmanager
def short_turns() -> Iterator[None]:
    """Lets other threads have the interpreter sooner, while this one learns.

    Python hands it over after 5 ms (`sys.setswitchinterval`), which is long for a control loop.
    """
    with _turns.lock:
        if _turns.learning == 0:
            _turns.usual = sys.getswitchinterval()
            sys.setswitchinterval(min(_TURN, _turns.usual))
        _turns.learning += 1
    try:
        yield
    finally:
        with _turns.lock:
            _turns.learning -= 1
            if _turns.learning == 0:
                sys.setswitchinterval(_turns.usual)


class _Turns:
    """How many threads are learning, and the usual length of a turn [s]."""

    def __init__(self) -> None:
        self.lock, self.learning, self.usual = threading.Lock(), 0, sys.getswitchinterval()


_turns = _Turns()
