"""Checks at the public boundary: what was expected, what came, before anything changes."""

from __future__ import annotations

import math
from operator import index
from typing import Any

import numpy as np
import torch
from torch import Tensor

LONGEST = 2**62  # [samples], which fit into an int64 twice
LARGEST = 1e17
"""Of a number whose distances from others are taken: its squares still add up in float32."""


def check_form(name: str, value: object, columns: int, like: Tensor) -> Tensor:
    """Checks all of a batch or sequence of rows but whether it is finite; arguments: `check_rows`.

    Raises:
        ValueError: not a tensor, or of the wrong shape, dtype or device.
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
    return value


def check_rows(name: str, value: object, columns: int, like: Tensor) -> Tensor:
    """Checks a batch or sequence of rows and hands it back unchanged.

    Args:
        name: what the rows are, for the message.
        value: what the caller gave; expected is a finite tensor `[rows ≥ 1, columns]`.
        columns: the expected number of columns.
        like: a tensor of the expected dtype and device.

    Raises:
        ValueError: not a tensor, or of the wrong shape, dtype or device, or not finite.
    """
    value = check_form(name, value, columns, like)
    finite = torch.isfinite(value)
    if not bool(finite.all()):
        row = int((~finite).any(dim=1).nonzero()[0])
        raise ValueError(f"expected finite {name}, got {value[row].tolist()} in row {row}")
    return value


def check_bounded(name: str, value: object, columns: int, like: Tensor) -> Tensor:
    """`check_rows` for rows whose distances are taken, which must not be too large to be finite.

    Raises:
        ValueError: as `check_rows`, or beyond ±`LARGEST`.
    """
    value = check_rows(name, value, columns, like)
    largest = float(value.detach().abs().max()) if value.numel() else 0.0
    if largest > LARGEST:
        raise ValueError(f"expected {name} within ±{LARGEST:g}, got {largest:g}")
    return value


def check_number(name: str, value: object, count: int, lowest: int = 0, where: str = "") -> int:
    """Checks the number of one of several things, any kind of integer, and hands it back as an int.

    Args:
        name: what it is the number of, for the message.
        value: what the caller gave.
        count: how many there are.
        lowest: the first number.
        where: what else there is to say of them, for the message.

    Raises:
        ValueError: no integer, or none from the lowest to `count` − 1.
    """
    try:
        number = None if isinstance(value, bool) else index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        number = None
    if number is None or not lowest <= number < count:
        raise ValueError(f"expected {name} from {lowest} to {count - 1}{where}, got {value!r}")
    return number


def check_numbers(name: str, value: object, count: int) -> Tensor:
    """Checks numbers of several things at once, int64 `[K]` ascending, and hands them back.

    Raises:
        ValueError: no such tensor, or a number that is not from 0 to `count` − 1.
    """
    is_strided = isinstance(value, Tensor) and value.layout == torch.strided
    if not isinstance(value, Tensor) or not is_strided or (value.dtype, value.dim()) != _NUMBERS:
        got = f"{value.dtype} {list(value.shape)}" if isinstance(value, Tensor) else repr(value)
        raise ValueError(f"expected {name} as an int64 tensor [K], got {got}")
    if len(value) and not (
        int(value[0]) >= 0 and int(value[-1]) < count and bool((value[1:] > value[:-1]).all())
    ):
        raise ValueError(
            f"expected ascending {name} from 0 to {count - 1}, got {value.tolist()[:8]}"
        )
    return value


_NUMBERS = torch.int64, 1


def batch_of_one(row: Any) -> Any:
    """A row `[D]` as `[1, D]`; what is no tensor stays, for `check_rows` to refuse."""
    return row[None] if isinstance(row, Tensor) else row


def batch_of_array(row: Any) -> Any:
    """The same of a row that may also be an array, which is copied; others stay as well."""
    if isinstance(row, np.ndarray) and not isinstance(row, np.ma.MaskedArray):
        try:
            row = torch.from_numpy(row.copy())
        except (TypeError, ValueError):  # torch has no such dtype
            return row
    return batch_of_one(row)


def check_fields(config: object, checks: dict[str, tuple[bool, str]]) -> None:
    """Raises a ValueError for the first field whose check failed, naming what is valid.

    Args:
        config: the config dataclass.
        checks: for each field, whether its value is valid and what would be.
    """
    for field, (valid, wanted) in checks.items():
        if not valid:
            kind = type(config).__name__
            raise ValueError(f"expected {kind}.{field} {wanted}, got {getattr(config, field)!r}")


def is_integer(value: object, lowest: int) -> bool:
    """Whether a field holds an integer ≥ `lowest`."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= lowest


def is_number(value: object) -> bool:
    """Whether a field holds a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value)
