"""Rows that grow: buffers of equal capacity with a live count, trimmed on save, resized on load.

Growing a module's state row by row needs more than `torch.cat`: a `state_dict` must hold the live
rows alone, loading must accept any number of them, and deleting a row must touch every column at
once. `GrowableRows` keeps those three promises for the nodes and edges of the map and for the
stored targets.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

_FEWEST = 128  # rows there is room for


class Column(NamedTuple):
    """What one column holds in each row."""

    shape: tuple[int, ...]
    dtype: torch.dtype


class GrowableRows(nn.Module):
    """Columns of equal length that grow by doubling.

    Each column is a registered buffer of shape `[capacity, *column.shape]` under its own name; the
    first `len(rows)` rows are alive and `live(name)` is the view of them. Row numbers are dense:
    deleting a row moves the later ones down and keeps their order.

    Args:
        columns: the name of each column and what a row of it holds.

    Attributes:
        count: the number of live rows, a numpy int64 array `[1]`, which compiled kernels that add
            or delete rows write themselves: so a row and its count are never apart.
    """

    def __init__(self, columns: Mapping[str, Column]) -> None:
        super().__init__()
        self.columns = dict(columns)
        self.count = np.zeros(1, np.int64)
        for name, column in self.columns.items():
            empty = torch.zeros(_FEWEST, *column.shape, dtype=column.dtype)
            self.register_buffer(name, empty)
        self.register_state_dict_post_hook(_trim_to_live_rows)
        self.register_load_state_dict_pre_hook(_make_room_for_loaded_rows)

    def __len__(self) -> int:
        """The number of live rows."""
        return int(self.count[0])

    @property
    def capacity(self) -> int:
        """The number of rows that fit without growing."""
        return min(len(getattr(self, name)) for name in self.columns)

    def live(self, name: str) -> Tensor:
        """The live rows of a column, `[len(self), *shape]`: a view, valid until the next change."""
        return getattr(self, name)[: len(self)]

    def append(self, row: Mapping[str, Tensor | float]) -> int:
        """Adds one row with a value for every column and returns its number."""
        index = self.extend(1)
        for name, value in row.items():
            self.get_buffer(name)[index] = value
        return index

    def extend(self, rows: int) -> int:
        """Adds rows of zeros and returns the number of the first."""
        first = len(self)
        self.make_room(rows)
        for name in self.columns:
            self.get_buffer(name)[first : first + rows] = 0
        self.count += rows
        return first

    def make_room(self, rows: int) -> None:
        """Grows, at least to twice the capacity, unless so many more rows fit already."""
        wanted = len(self) + rows
        if wanted <= self.capacity:
            return
        capacity = max(wanted, 2 * self.capacity)
        grown = {}
        for name in self.columns:
            old = getattr(self, name)
            grown[name] = old.new_zeros(capacity, *old.shape[1:])
            grown[name][: len(self)] = self.live(name)
        for name, new in grown.items():  # where memory is short, all of them stay as they are
            setattr(self, name, new)

    def keep(self, rows: Tensor) -> None:
        """Keeps the rows with these numbers, in this order, and drops all others.

        Args:
            rows: row numbers, int64 `[K]`.
        """
        for name in self.columns:
            buffer = self.get_buffer(name)
            buffer[: len(rows)] = buffer[rows]
        self.count[0] = len(rows)

    def swap_out(self, rows: Tensor) -> None:
        """Deletes the rows with these numbers, int64 `[K]` ascending, where their order is free.

        From the highest number down, the row that is then the last takes each one's place: a time
        that does not depend on how many rows there are.
        """
        for row in reversed(rows.tolist()):
            self.count -= 1
            for name in self.columns:
                buffer = self.get_buffer(name)
                buffer[row] = buffer[len(self)]

    def delete(self, rows: Tensor) -> None:
        """Deletes the rows with these numbers, int64 `[K]`; the later ones move down."""
        alive = torch.ones(len(self), dtype=torch.bool, device=rows.device)
        alive[rows] = False
        self.keep(alive.nonzero().flatten())


def _trim_to_live_rows(
    rows: nn.Module, state_dict: dict[str, Tensor], prefix: str, _metadata: object
) -> None:
    assert isinstance(rows, GrowableRows)
    for name in rows.columns:
        state_dict[prefix + name] = rows.live(name).detach().clone()


def _make_room_for_loaded_rows(
    rows: nn.Module, state_dict: dict[str, Tensor], prefix: str, *_: object
) -> None:
    """Resizes every column to the loaded one, for `load_state_dict` refuses any other shape."""
    assert isinstance(rows, GrowableRows)
    names = [name for name in rows.columns if prefix + name in state_dict]
    shapes = {name: tuple(state_dict[prefix + name].shape) for name in names}
    fits = {name: shapes[name][1:] == rows.columns[name].shape for name in names}
    if len(names) < len(rows.columns) or not all(len(shapes[n]) and fits[n] for n in names):
        return  # `load_state_dict` names what is missing or misshapen; the rows stay as they are
    counts = {name: shape[0] for name, shape in shapes.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"expected columns of equal length under '{prefix}', got {counts}")
    for name, count in counts.items():
        buffer = rows.get_buffer(name)
        setattr(rows, name, buffer.new_zeros(count, *buffer.shape[1:]))
        rows.count[0] = count
