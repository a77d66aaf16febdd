"""Kernels that numba compiles at their first use and keeps on disk.

They lie beside the library, or in numba's own cache where that is read-only. Where numba finds no
folder to write to, or the disk is full, each process compiles them anew and says so once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba import njit
from numba.core import event
from numba.core.caching import FunctionCache, NullCache


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return the decorator `njit(cache=True, **options)`, which here also works without a cache."""

    def decorate(function: Callable[..., Any]) -> Any:
        kernel: Any = njit(**options)(function)
        if kernel is not function:  # as it is with NUMBA_DISABLE_JIT
            try:
                kernel._cache = _Cache(function)
            except (OSError, RuntimeError) as error:  # OSError: the source has gone
                kernel._cache = _NoCache(error)
        return kernel

    return decorate


class _Cache(FunctionCache):
    """Numba's cache of one kernel; what goes wrong with it costs time, but is no error.

    Numba unpickles what it reads, so a damaged file may raise anything.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel, None if there is none to be read."""
        try:
            return super().load_overload(sig, target_context)
        except OSError:  # saving fails as well, and reports it
            return None
        except Exception:
            with suppress(OSError):
                self.flush()  # saving would read the damaged index again
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled kernel if possible."""
        try:
            super().save_overload(sig, data)
        except Exception as error:
            _messages.report_not_kept(error)


class _NoCache(NullCache):
    """Stands in for the cache of a kernel where there can be none."""

    def __init__(self, error: Exception) -> None:
        self._error = error

    def load_overload(self, sig: Any, target_context: Any) -> None:  # noqa: ARG002
        """Report before the kernel is compiled that it will not be kept."""
        _messages.report_not_kept(self._error)


class _Messages(event.Listener):
    """Prints to standard error that kernels are compiled, or are not kept, each once."""

    def __init__(self) -> None:
        self._has_announced = self._has_reported = False

    def on_start(self, event: Any) -> None:
        """Announce the first compilation of this library's."""
        module = event.data["dispatcher"].py_func.__module__ or ""
        if module.startswith("pacnet.") and not (self._has_announced or self._has_reported):
            self._has_announced = True
            print("pacnet: compiling for this machine, once, some 10 s ...", file=sys.stderr)

    def on_end(self, event: Any) -> None:
        """Do nothing."""

    def report_not_kept(self, error: Exception) -> None:
        """Say why each process compiles, and what to do about it."""
        if not self._has_reported:
            self._has_reported = True
            print(
                "pacnet: compiled kernels cannot be kept, so each process compiles them, some "
                f"10 s: set NUMBA_CACHE_DIR to a folder that can be written ({error})",
                file=sys.stderr,
            )


_messages = _Messages()
event.register("numba:compile", _messages)
