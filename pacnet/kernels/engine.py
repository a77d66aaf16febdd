"""Which engine runs the map: compiled kernels for float32 on the CPU, eager torch elsewhere."""

from __future__ import annotations

from typing import Literal, get_args

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
