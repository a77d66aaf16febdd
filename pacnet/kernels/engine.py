"""Which engine runs the map: compiled kernels for float32 on the CPU, eager torch everywhere else.

The eager methods are its specification. The kernels are compiled by numba when they are first
used, and kept on disk beside the library, or in numba's own cache where that is read-only.
"""

from __future__ import annotations

import sys
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Engine = Literal["auto", "eager", "compiled"]
"""`auto`: compiled wherever it can run; the others force one."""

_ENGINES = ("auto", "eager", "compiled")
_FLOAT32 = np.dtype(np.float32)


def check_engine(engine: object) -> None:
    """Raises a ValueError unless this names an engine."""
    if engine not in _ENGINES:
        raise ValueError(f"expected engine as one of {', '.join(_ENGINES)}, got {engine!r}")


def runs_compiled(engine: Engine, state: Tensor) -> bool:
    """Whether the compiled engine runs on a module whose state is like this tensor.

    Raises:
        ValueError: it is forced, but cannot.
    """
    if engine == "eager":
        return False
    possible = state.is_cpu and state.dtype == torch.float32
    if engine == "compiled" and not possible:
        raise ValueError(
            f"expected float32 on the CPU for engine='compiled', got {state.dtype} "
            f"on {state.device}"
        )
    return possible


def check_row(name: str, value: object, columns: int) -> NDArray[np.float32]:
    """One row as a `step` takes it, an array or a tensor on the CPU, float32 `[columns]`.

    Whether it is finite is left to the kernel.

    Raises:
        ValueError: anything else.
    """
    row = value
    if not isinstance(row, np.ndarray) and isinstance(value, Tensor) and _has_memory(value):
        row = value.detach().numpy()
    if isinstance(row, np.ndarray) and not isinstance(row, np.ma.MaskedArray):
        # Mostly there is but one such dtype, and to see that is faster than to compare.
        single = row.dtype is _FLOAT32 or row.dtype == _FLOAT32
        if single and row.shape == (columns,):
            return row if row.flags.carray else row.copy()  # another kind is compiled anew
    wanted = f"expected {name} as a float32 array of shape [{columns}]"
    if isinstance(row, np.ndarray):
        raise ValueError(f"{wanted}, got {row.dtype} {list(row.shape)}")
    if isinstance(value, Tensor):
        got = f"a {value.dtype} tensor {list(value.shape)} on {value.device}"
        raise ValueError(f"{wanted}, got {got}")
    raise ValueError(f"{wanted}, got {type(value).__name__}")


def _has_memory(row: Tensor) -> bool:
    """Whether an array can share it."""
    return row.is_cpu and row.dtype == torch.float32 and row.layout == torch.strided


def announce_compilation() -> None:
    """Has numba say, once a process, that it compiles one of this library's kernels.

    Each module of kernels calls it. A kernel that comes from the cache is not announced.
    """
    from numba.core import event

    class Announcement(event.Listener):
        said = False

        def on_start(self, event: Any) -> None:
            module = event.data["dispatcher"].py_func.__module__ or ""
            if not Announcement.said and module.startswith("pacnet."):
                Announcement.said = True
                print("pacnet: compiling for this machine, once, some 10 s ...", file=sys.stderr)

        def on_end(self, event: Any) -> None: ...

    if not _announcing:
        _announcing.append(Announcement())
        event.register("numba:compile", _announcing[0])


_announcing: list[Any] = []
