"""Checks of a caller's values at the public boundary, before anything changes."""

from __future__ import annotations

import math
from operator import index
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

MAX_SAMPLES = 2**62  # [samples]; the sum of two fits into an int64
MAX_VALUE = 1e17
"""Largest size of a number whose distances are taken: its squares still add up in float32."""
_FLOAT32 = np.dtype(np.float32)


def check_rows(
    name: str, value: object, columns: int, like: Tensor, *, finite: bool = True
) -> Tensor:
    """Return a tensor `[rows ≥ 1, columns]`, after checking it.

    Args:
        name: name of the rows, for the message.
        value: the rows.
        columns: the expected number of columns.
        like: a tensor of the expected dtype and device.
        finite: whether to refuse NaN and infinity.

    Raises:
        ValueError: not a tensor, or of the wrong shape, dtype or device, or not finite.
    """
    wanted = f"expected {name} as a {like.dtype} tensor of shape [rows, {columns}] on {like.device}"
    if not isinstance(value, Tensor) or value.layout != torch.strided:
        got = value.layout if isinstance(value, Tensor) else type(value).__name__
        raise ValueError(f"{wanted}, got {got}")
    if value.dim() != 2 or value.shape[1] != columns:
        raise ValueError(f"{wanted}, got shape {list(value.shape)}")
    if value.dtype != like.dtype:
        raise ValueError(f"{wanted}, got dtype {value.dtype}")
    if value.device != like.device:
        raise ValueError(f"{wanted}, got one on {value.device}")
    if len(value) == 0:
        raise ValueError(f"{wanted} with at least one row, got an empty one")
    if finite and not bool(torch.isfinite(value).all()):
        row = int((~torch.isfinite(value)).any(dim=1).nonzero()[0])
        raise ValueError(f"expected finite {name}, got {value[row].tolist()} in row {row}")
    return value


def check_bounded(name: str, value: object, columns: int, like: Tensor) -> Tensor:
    """Check rows as `check_rows` does, and that their distances from others are finite.

    Raises:
        ValueError: as `check_rows`, or beyond ±`MAX_VALUE`.
    """
    value = check_rows(name, value, columns, like)
    largest = float(value.detach().abs().max()) if value.numel() else 0.0
    if largest > MAX_VALUE:
        raise ValueError(f"expected {name} within ±{MAX_VALUE:g}, got {largest:g}")
    return value


def describe(value: object) -> str:
    """Return dtype, shape and device of an array or tensor, or the type of anything else."""
    if not isinstance(value, np.ndarray | Tensor):
        return type(value).__name__
    device = f" on {value.device}" if isinstance(value, Tensor) and not value.is_cpu else ""
    return f"{value.dtype} {list(value.shape)}{device}"


def check_same_length(**rows: Tensor) -> None:
    """Raise a ValueError unless the named tensors have equally many rows."""
    counts = {name: len(value) for name, value in rows.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"expected equally many rows, got {counts}")


def check_row(name: str, value: object, columns: int) -> NDArray[np.float32]:
    """Return one row of a control loop as an array; the kernel checks that it is finite.

    Raises:
        ValueError: not an array, or tensor on the CPU, of float32 `[columns]`.
    """
    row = value
    if not isinstance(value, np.ndarray) and isinstance(value, Tensor):
        shares_memory = value.is_cpu and value.layout == torch.strided
        row = value.detach().numpy() if shares_memory and value.dtype == torch.float32 else value
    if isinstance(row, np.ndarray) and not isinstance(row, np.ma.MaskedArray):
        # There is usually a single object of this dtype; comparing identity is faster.
        is_float32 = row.dtype is _FLOAT32 or row.dtype == _FLOAT32
        if is_float32 and row.shape == (columns,):
            return row if row.flags.carray else row.copy()  # numba compiles per memory layout
    raise ValueError(
        f"expected {name} as a float32 array of shape [{columns}], got {describe(value)}"
    )


def check_index(name: str, value: object, count: int, *, optional: bool = False) -> int:
    """Return an index of any integer type as an int; −1 is valid, for none, if it is optional.

    Raises:
        ValueError: not an integer, or out of range.
    """
    lowest = -1 if optional else 0
    try:
        number = None if isinstance(value, bool) else index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        number = None
    if number is None or not lowest <= number < count:
        none = ", -1 for none" if optional else ""
        raise ValueError(f"expected {name} from {lowest} to {count - 1}{none}, got {value!r}")
    return number


def check_indices(name: str, value: object, count: int) -> Tensor:
    """Check indices of several things, int64 `[K]` ascending, and return them.

    Raises:
        ValueError: not such a tensor, or an index that is not from 0 to `count` − 1.
    """
    if (
        not isinstance(value, Tensor)
        or value.layout != torch.strided
        or (value.dtype, value.dim()) != (torch.int64, 1)
    ):
        raise ValueError(f"expected {name} as an int64 tensor [K], got {describe(value)}")
    if len(value) and not (
        int(value[0]) >= 0 and int(value[-1]) < count and bool((value[1:] > value[:-1]).all())
    ):
        raise ValueError(
            f"expected ascending {name} from 0 to {count - 1}, got {value.tolist()[:8]}"
        )
    return value


def as_batch(row: Any, *, arrays: bool = False) -> Any:
    """Return a tensor `[D]` (or array, if `arrays`) as a tensor `[1, D]`, others unchanged."""
    if arrays and isinstance(row, np.ndarray) and not isinstance(row, np.ma.MaskedArray):
        try:
            row = torch.from_numpy(row.copy())
        except (TypeError, ValueError):  # torch has no such dtype
            return row
    return row[None] if isinstance(row, Tensor) else row


def check_fields(config: object, checks: dict[str, tuple[bool, str]]) -> None:
    """Raise a ValueError for the first invalid field of a config dataclass.

    The checks say for each field whether its value is valid, and which values are.
    """
    for field, (valid, wanted) in checks.items():
        if not valid:
            kind = type(config).__name__
            raise ValueError(f"expected {kind}.{field} {wanted}, got {getattr(config, field)!r}")


def is_integer(value: object, lowest: int) -> bool:
    """Return whether a field holds an integer ≥ `lowest`."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= lowest


def is_number(value: object) -> bool:
    """Return whether a field holds a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
