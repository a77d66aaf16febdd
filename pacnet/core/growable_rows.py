"""Rows that grow: columns of equal length, resized on load.

Growing a module's state row by row needs more than `torch.cat`: a `state_dict` must hold the rows
and nothing else, loading must accept any number of them, and deleting a row must touch every column
at once. `GrowableRows` keeps those three promises for the nodes and edges of the map and for the
stored targets.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

_FEWEST = 128  # rows that are made room for at once
_TWO_LINES = 32  # float32 numbers in two lines of a cache


class Column(NamedTuple):
    """What one column holds in each row."""

    shape: tuple[int, ...]
    dtype: torch.dtype
    by_dimension: bool = False
    """Whether a vector's dimensions lie apart in memory, each for all rows: kernels that compare
    something with all of them read it faster."""


def check_storage(name: str, tensor: Tensor) -> Tensor:
    """Hands a tensor back, unless it is no longer all in memory, as after `resize_(0)` of that.

    Raises:
        ValueError: it is not; torch itself would read on, beyond the end of its memory.
    """
    elements = tensor.numel()
    if elements and not tensor.is_contiguous():
        strides = zip(tensor.shape, tensor.stride(), strict=True)
        elements = 1 + sum((size - 1) * stride for size, stride in strides)
    size, there = tensor.element_size(), tensor.untyped_storage().nbytes()
    if elements and (tensor.storage_offset() + elements) * size > there:
        raise ValueError(
            f"expected {name} with its {elements} elements in memory, got {there} bytes of them"
        )
    return tensor


def copy_on_state_dict(module: nn.Module) -> None:
    """Has `state_dict` copy the module's own buffers, which it changes in place."""
    module.register_state_dict_post_hook(_copy_buffers)


def _copy_buffers(
    module: nn.Module, state_dict: dict[str, Tensor], prefix: str, _metadata: object
) -> None:
    for name in module._buffers:
        if prefix + name in state_dict:
            state_dict[prefix + name] = check_storage(name, state_dict[prefix + name]).clone(
                memory_format=torch.contiguous_format
            )


class GrowableRows(nn.Module):
    """Columns of equal length that grow by doubling.

    Each column is a registered buffer of shape `[len(rows), *column.shape]` under its own name: a
    view of memory that has room for more. What says how many rows there are is therefore the
    buffers themselves, and rows that were added later lie outside of a view that somebody took
    before. Row numbers are dense: deleting a row moves the later ones down and keeps their order.

    Args:
        columns: the name of each column and what a row of it holds.
    """

    def __init__(self, columns: Mapping[str, Column]) -> None:
        super().__init__()
        self.columns = dict(columns)
        self._memory: dict[str, Tensor] = {}  # of which each buffer is the beginning
        for name, column in self.columns.items():
            self.register_buffer(name, torch.zeros(0, *column.shape, dtype=column.dtype))
        copy_on_state_dict(self)  # else they would be parts of larger memory
        self.register_load_state_dict_pre_hook(_resize_to_loaded_rows)

    def __len__(self) -> int:
        """The number of rows."""
        for buffer in self._buffers.values():
            return buffer.shape[0] if buffer.dim() else 0  # pyright: ignore[reportOptionalMemberAccess]
        return 0

    def extra_repr(self) -> str:
        """Return the number of rows and what each holds, for `print`."""
        columns = (f"{name}{list(column.shape) or ''}" for name, column in self.columns.items())
        return f"rows={len(self)}, columns=({', '.join(columns)})"

    def live(self, name: str) -> Tensor:
        """A column, `[len(self), *shape]`, valid until the next change.

        Raises:
            ValueError: it is no longer all in memory.
        """
        return check_storage(name, self._buffers[name])  # pyright: ignore[reportArgumentType]

    def append(self, row: Mapping[str, Tensor | float]) -> int:
        """Adds one row with a value for every column and returns its number."""
        index = self.extend(1)
        for name, value in row.items():
            self.live(name)[index] = value
        return index

    def extend(self, rows: int) -> int:
        """Adds rows of zeros and returns the number of the first.

        Raises:
            ValueError: as `check`.
        """
        self.check()
        first = len(self)
        for name, memory in self._with_room(rows).items():
            self._in_rows(name, memory)[first : first + rows] = 0
        self.show(first + rows)
        return first

    def arrays(self, rows: int) -> dict[str, NDArray[Any]]:
        """The columns with room for so many more rows, as arrays of their memory.

        One that lies `by_dimension` is of shape `[*shape, rows]`. Whoever writes rows calls `show`
        with their number.

        Raises:
            ValueError: as `check`, or columns of another type than they were made with.
        """
        self.check()
        for name, column in self.columns.items():
            buffer = self.get_buffer(name)
            if buffer.dtype != column.dtype or not buffer.is_cpu:
                raise ValueError(
                    f"expected {name} as {column.dtype} on the CPU, got {buffer.dtype} on "
                    f"{buffer.device}"
                )
        return {name: memory.numpy() for name, memory in self._with_room(rows).items()}

    def show(self, count: int) -> None:
        """Makes it `count` rows, of those that there is room for."""
        for name, memory in self._memory.items():
            self._buffers[name] = self._in_rows(name, memory)[:count]

    def select(self, rows: Tensor) -> None:
        """Keeps the rows with these numbers, in this order, and drops all others.

        They move to other memory: who reads the old rows meanwhile reads them unchanged.

        Args:
            rows: row numbers, int64 `[K]`.

        Raises:
            ValueError: as `check`.
        """
        self.check()
        with torch.inference_mode(False):  # a caller's would make them unchangeable later
            kept = {name: self.live(name)[rows] for name in self.columns}
            self._memory = {name: self._laid_out(name, rows) for name, rows in kept.items()}
            self.show(len(rows))

    def swap_remove(self, rows: Tensor) -> None:
        """Deletes the rows with these numbers, int64 `[K]` ascending, where their order is free.

        From the highest number down, the row that is then the last takes each one's place.
        """
        order = list(range(len(self)))
        for row in reversed(rows.tolist()):
            order[row] = order[-1]
            order.pop()
        self.select(rows.new_tensor(order))

    def delete(self, rows: Tensor) -> None:
        """Deletes the rows with these numbers, int64 `[K]`; the later ones move down."""
        alive = torch.ones(len(self), dtype=torch.bool, device=rows.device)
        alive[rows] = False
        self.select(alive.nonzero().flatten())

    def check(self) -> None:
        """Checks what a user may have done to the buffers, before anything relies on them.

        Raises:
            ValueError: columns of other shapes or kinds of numbers, of unequal length, or without
                their memory.
        """
        for name, column in self.columns.items():
            buffer = self.live(name)
            float_in_both = buffer.is_floating_point() and column.dtype.is_floating_point
            if buffer.dtype != column.dtype and not float_in_both:
                raise ValueError(f"expected {name} as {column.dtype}, got {buffer.dtype}")
            if buffer.shape != (len(self), *column.shape):
                raise ValueError(
                    f"expected {name} of shape {[len(self), *column.shape]}, as the other "
                    f"columns, got {list(buffer.shape)}"
                )

    def copy_memory(self) -> None:
        """Has memory of its own, with room, where so far it shared another's."""
        count, rows = len(self), self._buffers
        whole = all(self._room(name) >= count for name in self.columns)
        self._buffers = dict(rows)
        if whole and count > 0:
            self._memory = {name: memory.clone() for name, memory in self._memory.items()}
            self.show(count)
            return
        for name, buffer in rows.items():
            self._buffers[name] = None if buffer is None else buffer.clone()

    def by_dimension(self, name: str) -> tuple[NDArray[Any], int]:
        """A column on the CPU as an array `[*shape, rows or more]`, and how many rows it has.

        It is the memory itself, or else a copy.

        Raises:
            ValueError: it is no longer all in memory.
        """
        buffer, memory = self.live(name), self._memory.get(name)  # others may change both
        if memory is not None and self._is_beginning_of(buffer, name, memory):
            return memory.numpy(), len(buffer)
        return np.ascontiguousarray(buffer.detach().numpy().T), len(buffer)

    def _laid_out(self, name: str, rows: Tensor) -> Tensor:
        """Memory that holds just these rows."""
        return rows.T.contiguous() if self.columns[name].by_dimension else rows.contiguous()

    def _in_rows(self, name: str, memory: Tensor) -> Tensor:
        return memory.T if self.columns[name].by_dimension else memory

    def _with_room(self, rows: int) -> dict[str, Tensor]:
        """The memory of each column, with room for so many more rows."""
        count = len(self)
        if any(self._room(name) < count + rows for name in self.columns):
            room, grown = max(count + rows, 2 * count, _FEWEST), {}
            # An odd number of cache lines, or the dimensions of a row would compete for one place.
            room = room // _TWO_LINES * _TWO_LINES + 3 * _TWO_LINES // 2
            with torch.inference_mode(False):  # a caller's would make them unchangeable later
                for name in self.columns:
                    rows_now = self.live(name)
                    shape = (room, *rows_now.shape[1:])
                    turned = self.columns[name].by_dimension
                    grown[name] = rows_now.new_zeros(shape[::-1] if turned else shape)
                    self._in_rows(name, grown[name])[:count] = rows_now
                self._memory = grown  # where memory is short, all of them stay as they are
                self.show(count)
        return self._memory

    def _room(self, name: str) -> int:
        """Rows that fit into a column's memory; none, if the buffer has become another tensor."""
        memory = self._memory.get(name)
        if memory is None or not self._is_beginning_of(self.get_buffer(name), name, memory):
            return -1
        return len(self._in_rows(name, memory))

    def _is_beginning_of(self, buffer: Tensor, name: str, memory: Tensor) -> bool:
        rows = self._in_rows(name, memory)
        same = rows.dtype == buffer.dtype and rows.stride() == buffer.stride()
        return same and rows.device == buffer.device and rows.data_ptr() == buffer.data_ptr()


def _resize_to_loaded_rows(
    rows: nn.Module, state_dict: dict[str, Tensor], prefix: str, *_: object
) -> None:
    """Resizes every column to the loaded one, for `load_state_dict` refuses any other shape.

    Raises:
        ValueError: a column is missing or misshapen, or they are of unequal length; the rows are
            as they were.
    """
    assert isinstance(rows, GrowableRows)
    loaded = {name: state_dict.get(prefix + name) for name in rows.columns}
    if all(tensor is None for tensor in loaded.values()):
        return  # nothing of it is loaded: `load_state_dict` says so, if it is strict
    lengths = {name: len(t) if t is not None and t.dim() else None for name, t in loaded.items()}
    for name, tensor in loaded.items():
        shape = rows.columns[name].shape
        if tensor is None or tensor.dim() == 0 or tuple(tensor.shape[1:]) != shape:
            got = "none" if tensor is None else list(tensor.shape)
            raise ValueError(f"expected {prefix}{name} of shape [rows, *{list(shape)}], got {got}")
    if len(set(lengths.values())) > 1:
        raise ValueError(f"expected columns of equal length under '{prefix}', got {lengths}")
    with torch.inference_mode(False):
        empty = {
            name: rows.live(name).new_zeros(t.shape) for name, t in loaded.items() if t is not None
        }
        rows._memory = {name: rows._laid_out(name, zeros) for name, zeros in empty.items()}
        rows.show(next(iter(lengths.values())) or 0)


def in_single(rows: Tensor) -> Tensor:
    """Return half precision as float32, for what cannot be computed in it; other rows as is."""
    return rows.float() if rows.dtype in (torch.half, torch.bfloat16) else rows


def as_array(rows: Tensor) -> NDArray[Any]:
    """Return rows as a contiguous array, of the same memory where possible, half as single."""
    return in_single(rows.detach()).contiguous().numpy(force=True)
