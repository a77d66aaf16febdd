"""Checks at the public boundary: what was expected, what came, before anything changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor


def check_form(name: str, value: object, columns: int, like: Tensor) -> Tensor:
    """Checks all of a batch or sequence of rows but whether it is finite; arguments: `check_rows`.

    Raises:
        ValueError: not a tensor, or of the wrong shape, dtype or device.
    """
    wanted = f"expected {name} as a {like.dtype} tensor of shape [rows, {columns}] on {like.device}"
    if not isinstance(value, Tensor):
        raise ValueError(f"{wanted}, got {type(value).__name__}")
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


def batch_of_one(row: Any) -> Any:
    """A row `[D]` as `[1, D]`; what is no tensor stays, for `check_rows` to refuse."""
    return row[None] if isinstance(row, Tensor) else row


def batch_of_array(row: Any) -> Any:
    """The same of a row that may also be an array, which is copied."""
    return batch_of_one(torch.from_numpy(row.copy()) if isinstance(row, np.ndarray) else row)


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
