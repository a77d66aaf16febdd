"""Rows that grow: columns of equal length, appended to in place and resized on load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

_MIN_CAPACITY = 128  # [rows]
_TWO_LINES = 32  # float32 numbers in two lines of a cache


class Column(NamedTuple):
    """What one column holds in each row."""

    shape: tuple[int, ...]
    dtype: torch.dtype
    transposed: bool = False
    """Whether memory holds one dimension of all rows after the other, which kernels that compare a
    vector with all rows read faster."""


def check_storage(name: str, tensor: Tensor) -> Tensor:
    """Return a tensor unchanged, after checking that its memory is still there.

    Raises:
        ValueError: its storage is too small, as after `resize_(0)`; torch would read beyond it.
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
    """Let `state_dict` copy the module's own buffers, which it changes in place."""
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
    """Columns of equal length that grow by doubling, in amortised constant time.

    Each column is a registered buffer `[len(rows), *column.shape]` under its own name: a view of
    the beginning of larger memory. Views that were taken before keep their rows when more are
    appended, and so does a module that shares the memory: to torch its buffers have not changed. A
    `state_dict` holds the rows alone; loading accepts any number of them.

    Methods raise a ValueError, and change nothing, if buffers were replaced by tensors of other
    shapes or types, of unequal length, or without memory.

    Args:
        columns: the name of each column and what a row of it holds.
    """

    def __init__(self, columns: Mapping[str, Column]) -> None:
        super().__init__()
        self.columns = dict(columns)
        self._memory: dict[str, Tensor] = {}  # [capacity, *shape], which the buffers begin
        for name, column in self.columns.items():
            self.register_buffer(name, torch.zeros(0, *column.shape, dtype=column.dtype))
        copy_on_state_dict(self)
        self.register_load_state_dict_pre_hook(_resize_to_loaded_rows)

    def __len__(self) -> int:
        """Return the number of rows."""
        for buffer in self._buffers.values():
            return buffer.shape[0] if buffer.dim() else 0  # pyright: ignore[reportOptionalMemberAccess]
        return 0

    def extra_repr(self) -> str:
        """Return the number of rows and what each holds, for `print`."""
        columns = (f"{name}{list(column.shape) or ''}" for name, column in self.columns.items())
        return f"rows={len(self)}, columns=({', '.join(columns)})"

    def live(self, name: str) -> Tensor:
        """Return a column, `[len(self), *shape]`, valid until the next change."""
        return check_storage(name, self._buffers[name])  # pyright: ignore[reportArgumentType]

    def append(self, row: Mapping[str, Tensor | float]) -> int:
        """Append one row with a value for every column and return its number."""
        number = self.extend(1)
        for name, value in row.items():
            self.live(name)[number] = value
        return number

    def extend(self, rows: int) -> int:
        """Append rows of zeros and return the number of the first."""
        first = len(self)
        for memory in self._reserve(rows).values():
            memory[first : first + rows] = 0
        self.set_length(first + rows)
        return first

    def arrays(self, rows: int) -> dict[str, NDArray[Any]]:
        """Return the memory of each column, with capacity for so many more rows, as an array.

        A transposed column is an array `[*shape, capacity]`, any other `[capacity, *shape]`. Call
        `set_length` after writing rows into them. Columns must have the types they were made with.
        """
        arrays = {}
        for name, memory in self._reserve(rows).items():
            _, dtype, transposed = self.columns[name]
            if memory.dtype != dtype or not memory.is_cpu:
                got = f"{memory.dtype} on {memory.device}"
                raise ValueError(f"expected {name} as {dtype} on the CPU, got {got}")
            arrays[name] = (memory.T if transposed else memory).numpy()
        return arrays

    def set_length(self, rows: int) -> None:
        """Set the number of rows, at most the capacity; new rows keep what memory holds."""
        for name, memory in self._memory.items():
            self._buffers[name] = memory.data[:rows]  # with a count of changes of its own

    def select(self, rows: Tensor) -> None:
        """Keep only the rows with these numbers, int64 `[K]`, in this order.

        They move to other memory, so a thread that reads the old rows sees them unchanged.
        """
        self.check()
        with torch.inference_mode(False):  # a caller's would make them unchangeable later
            self._take({name: self.live(name)[rows] for name in self.columns})

    def replace(self, rows: Mapping[str, Tensor]) -> None:
        """Replace all rows by copies of others, `[K, *shape]` for each column.

        They are in other memory, so a thread that reads the old rows sees them unchanged.
        """
        self.check()
        with torch.inference_mode(False):
            self._take({name: rows[name].to(self.live(name), copy=True) for name in self.columns})

    def _take(self, rows: Mapping[str, Tensor]) -> None:
        """Take tensors of this module's own as its rows."""
        self._memory = {
            name: values.T.contiguous().T if self.columns[name].transposed else values
            for name, values in rows.items()
        }
        self.set_length(len(next(iter(rows.values()))))

    def swap_remove(self, rows: Tensor) -> None:
        """Delete rows, int64 `[K]` ascending, without keeping the order of the others.

        From the highest number down, the last row takes the place of each deleted one.
        """
        order = list(range(len(self)))
        for row in reversed(rows.tolist()):
            order[row] = order[-1]
            order.pop()
        self.select(rows.new_tensor(order))

    def delete(self, rows: Tensor) -> None:
        """Delete rows, int64 `[K]`; later ones move down."""
        kept = torch.ones(len(self), dtype=torch.bool, device=rows.device)
        kept[rows] = False
        self.select(kept.nonzero().flatten())

    def check(self) -> None:
        """Check that the buffers are still columns of equal length; any float type is valid."""
        _check_shapes(self.columns, self._buffers, "")
        for name, (_, dtype, _) in self.columns.items():
            got = self.live(name).dtype
            if got != dtype and not (got.is_floating_point and dtype.is_floating_point):
                raise ValueError(f"expected {name} as {dtype}, got {got}")

    def fork(self) -> GrowableRows:
        """Return rows that share what is there; those appended to either are not the other's."""
        other = GrowableRows(self.columns)  # what is loaded into it is loaded into no other
        other.training = self.training
        other._buffers = {name: self.live(name).data for name in self.columns}
        return other

    def copy_memory(self) -> None:
        """Replace memory that is shared with another module by a copy of the same capacity."""
        rows, self._buffers = len(self), dict(self._buffers)
        if rows > 0 and all(self._capacity(name) >= rows for name in self.columns):
            self._memory = {name: memory.clone() for name, memory in self._memory.items()}
            self.set_length(rows)
        else:
            self._buffers.update((name, self.live(name).clone()) for name in self.columns)

    def transposed(self, name: str) -> tuple[NDArray[Any], int]:
        """Return a column on the CPU as an array `[*shape, ≥ rows]`, and the number of rows.

        The array is the memory itself, or a copy if the buffer is not part of it.
        """
        buffer, memory = self.live(name), self._memory.get(name)  # another thread may change both
        if memory is not None and _begins(buffer, memory):
            return memory.numpy().T, len(buffer)
        return np.ascontiguousarray(buffer.detach().numpy().T), len(buffer)

    def _reserve(self, rows: int) -> dict[str, Tensor]:
        """Return each column's memory, checked, with capacity for so many more rows."""
        self.check()
        count = len(self)
        if all(self._capacity(name) >= count + rows for name in self.columns):
            return self._memory
        # An odd number of cache lines, so that the dimensions of a row lie in different cache sets.
        capacity = max(count + rows, 2 * count, _MIN_CAPACITY)
        capacity = capacity // _TWO_LINES * _TWO_LINES + 3 * _TWO_LINES // 2
        grown = {}
        with torch.inference_mode(False):  # a caller's would make them unchangeable later
            for name in self.columns:
                grown[name] = self._zeros(name, capacity)
                grown[name][:count] = self.live(name)
            self._memory = grown  # only now: without enough memory, nothing has changed
            self.set_length(count)
        return grown

    def _zeros(self, name: str, rows: int) -> Tensor:
        """Return memory for a column `[rows, *shape]`."""
        shape, like = (rows, *self.columns[name].shape), self.live(name)
        if self.columns[name].transposed:
            return like.new_zeros(shape[::-1]).T
        return like.new_zeros(shape)

    def _capacity(self, name: str) -> int:
        """Return how many rows fit into a column's memory; −1 if the buffer is not part of it."""
        buffer, memory = self.get_buffer(name), self._memory.get(name)
        return -1 if memory is None or not _begins(buffer, memory) else len(memory)


def _begins(buffer: Tensor, memory: Tensor) -> bool:
    """Return whether a buffer is the beginning of memory."""
    same = memory.dtype == buffer.dtype and memory.stride() == buffer.stride()
    return same and memory.device == buffer.device and memory.data_ptr() == buffer.data_ptr()


def _check_shapes(columns: Mapping[str, Column], tensors: Mapping[str, Any], prefix: str) -> int:
    """Return how many rows the tensors have; raise a ValueError unless they are the columns."""
    rows = None
    for name, column in columns.items():
        tensor = tensors.get(prefix + name)
        got = tuple(tensor.shape) if isinstance(tensor, Tensor) else None
        if not got or got[1:] != column.shape or rows not in (None, got[0]):
            wanted = ", ".join(map(str, ("rows" if rows is None else rows, *column.shape)))
            raise ValueError(
                f"expected {prefix}{name} of shape [{wanted}], "
                f"got {'none' if got is None else list(got)}"
            )
        rows = got[0]
    return rows or 0


def _resize_to_loaded_rows(
    rows: nn.Module, state_dict: dict[str, Tensor], prefix: str, *_: object
) -> None:
    """Resize every column to the loaded one, because `load_state_dict` refuses other shapes."""
    assert isinstance(rows, GrowableRows)
    if not any(prefix + name in state_dict for name in rows.columns):
        return  # `load_state_dict` reports missing columns, if it is strict
    count = _check_shapes(rows.columns, state_dict, prefix)
    with torch.inference_mode(False):
        rows._memory = {name: rows._zeros(name, count) for name in rows.columns}
        rows.set_length(count)


def in_single(rows: Tensor) -> Tensor:
    """Return rows in half precision as float32, other rows unchanged."""
    return rows.float() if rows.dtype in (torch.half, torch.bfloat16) else rows


def as_array(rows: Tensor) -> NDArray[Any]:
    """Return rows as a contiguous array, if possible without a copy; half precision as float32."""
    return in_single(rows.detach()).contiguous().numpy(force=True)
