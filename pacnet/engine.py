"""Which engine runs: compiled kernels on float32 buffers on the CPU, eager torch everywhere else.

The eager methods are the specification. The kernels are compiled by numba when they are first
used, and kept on disk beside the library, or in numba's own cache where that is read-only.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
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


class Memory:
    """Where tensors lie in memory, looked up anew whenever one has moved.

    A kernel takes the addresses instead of arrays: handing over an array takes longer than a small
    map takes to search.

    Attributes:
        held: the table that kernels read, int64, and the tensors themselves. Whoever keeps both may
            use the addresses: no other tensor can come to lie there.
    """

    def __init__(self) -> None:
        self._addresses: tuple[int, ...] = ()
        self.held: tuple[NDArray[np.int64], tuple[Tensor, ...]] = (np.zeros(0, np.int64), ())

    def holds(self, addresses: tuple[int, ...]) -> bool:
        """Whether the tensors that were kept last lie at these addresses, in this order."""
        return addresses == self._addresses

    def keep(self, tensors: tuple[Tensor, ...], sizes: tuple[int, ...]) -> None:
        """Sets the table: the addresses of contiguous tensors on the CPU, then the sizes."""
        # Detached, they keep the memory itself, whatever is done to the tensors' data.
        kept = tuple(tensor.detach() for tensor in tensors)
        addresses = tuple(tensor.data_ptr() for tensor in kept)
        self.held = np.array([*addresses, *sizes], np.int64), kept
        self._addresses = addresses  # last: until then nothing counts as found

    def __deepcopy__(self, _memo: object) -> Memory:
        """A copied module looks up its own tensors."""
        return Memory()

    def __reduce__(self) -> tuple[type[Memory], tuple[()]]:
        """Nor does a pickled one keep addresses."""
        return Memory, ()


def check_buffers(buffers: Mapping[str, tuple[Tensor, torch.dtype]]) -> tuple[Tensor, ...]:
    """The tensors, after a check that each is what kernels take it for.

    Args:
        buffers: each by its name, with the dtype that it must have.

    Raises:
        ValueError: one of another dtype, elsewhere than on the CPU, or not contiguous.
    """
    for name, (tensor, dtype) in buffers.items():
        if not (tensor.is_cpu and tensor.dtype == dtype and tensor.is_contiguous()):
            raise ValueError(
                f"expected {name} as a contiguous {dtype} tensor on the CPU, "
                f"got {tensor.dtype} on {tensor.device}, strides {tensor.stride()}"
            )
    return tuple(tensor for tensor, _ in buffers.values())


def check_row(name: str, value: object, columns: int) -> NDArray[np.float32]:
    """One row as a `step` takes it, an array or a tensor on the CPU, float32 `[columns]`.

    Whether it is finite is left to the kernel.

    Raises:
        ValueError: anything else.
    """
    row = value
    if not isinstance(row, np.ndarray) and isinstance(value, Tensor) and value.is_cpu:
        row = value.detach().numpy()
    if isinstance(row, np.ndarray):
        # Mostly there is but one such dtype, and to see that is faster than to compare.
        single = row.dtype is _FLOAT32 or row.dtype == _FLOAT32
        if single and row.shape == (columns,):
            return row
    wanted = f"expected {name} as a float32 array of shape [{columns}]"
    if isinstance(row, np.ndarray):
        raise ValueError(f"{wanted}, got {row.dtype} {list(row.shape)}")
    where = f" on {value.device}" if isinstance(value, Tensor) else ""
    raise ValueError(f"{wanted}, got {type(value).__name__}{where}")


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
