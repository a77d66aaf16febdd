"""Which engine runs the map: compiled kernels for float32 on the CPU, eager torch elsewhere.

Numba compiles the kernels at their first use and keeps them on disk beside the library, or in its
own cache where that is read-only.
"""

from __future__ import annotations

import functools
import sys
from typing import Any, Literal, get_args

import torch
from torch import Tensor

Engine = Literal["auto", "eager", "compiled"]
"""`auto`: compiled wherever it can run; the others force one."""


def check_engine(engine: object) -> None:
    """Raise a ValueError unless this names an engine."""
    if engine not in get_args(Engine):
        raise ValueError(f"expected engine as one of {', '.join(get_args(Engine))}, got {engine!r}")


def runs_compiled(engine: Engine, state: Tensor) -> bool:
    """Return whether the compiled engine runs on a module whose state is like this tensor.

    Raises:
        ValueError: it is forced, but cannot.
    """
    if engine == "eager":
        return False
    possible = state.is_cpu and state.dtype == torch.float32
    if engine == "compiled" and not possible:
        got = f"{state.dtype} on {state.device}"
        raise ValueError(f"expected float32 on the CPU for engine='compiled', got {got}")
    return possible


@functools.cache
def announce_compilation() -> None:
    """Print one line in this process when numba first compiles a kernel of this library."""
    from numba.core import event

    class Announcement(event.Listener):
        printed = False

        def on_start(self, event: Any) -> None:
            module = event.data["dispatcher"].py_func.__module__ or ""
            if not Announcement.printed and module.startswith("pacnet."):
                Announcement.printed = True
                print("pacnet: compiling for this machine, once, some 10 s ...", file=sys.stderr)

        def on_end(self, event: Any) -> None: ...

    event.register("numba:compile", Announcement())
