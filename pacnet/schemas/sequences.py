"""Growable sequences of targets in one pool, each target with the percept it was shown with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.growable_rows import Column, GrowableRows, as_array
from pacnet.core.old_names import rename_on_load
from pacnet.core.validation import check_bounded, check_index

INTEGER = Column((), torch.int64)
OLD_TENSORS = {"passes": "visits", "room": "capacity"}
"""Parts of tensors' names in checkpoints of the last release -> those of today."""


class Sequences(nn.Module):
    """Sequences of (target, cue) rows in one pool, one contiguous block each.

    `blocks` holds where each sequence starts, its length, and the capacity of its block. A sequence
    that outgrows its block moves to the pool's end, so appending takes constant time on average. A
    saved pool has no gaps.

    Args:
        target_dimensions: length A of a target.
        cue_dimensions: length D of a cue.
        of_sequence: further columns of each sequence.
        of_row: further columns of each target.
    """

    def __init__(
        self,
        target_dimensions: int,
        cue_dimensions: int,
        of_sequence: Mapping[str, Column],
        of_row: Mapping[str, Column] | None = None,
    ) -> None:
        super().__init__()
        self.pool = GrowableRows(
            {
                "target": Column((target_dimensions,), torch.float32),
                "cue": Column((cue_dimensions,), torch.float32),
                **(of_row or {}),
            }
        )
        self.blocks = GrowableRows(
            {"start": INTEGER, "length": INTEGER, "capacity": INTEGER, **of_sequence}
        )
        self.register_state_dict_pre_hook(compact)
        rename_on_load(self, OLD_TENSORS)

    @property
    def lengths(self) -> Tensor:
        """Number of targets of each sequence, int64 `[N]`."""
        return self.blocks.live("length")

    def targets(self, sequence: int) -> Tensor:
        """Return the sequence's targets in order, `[L, A]`."""
        return self.rows_in("target", sequence)

    def cues(self, sequence: int) -> Tensor:
        """Return the normalized percepts that the targets were shown with, `[L, D]`."""
        return self.rows_in("cue", sequence)

    def arrays(self, column: str) -> NDArray[Any]:
        """Return a column of the pool as an array, which shares its memory where that is possible.

        Raises:
            ValueError: buffers that contradict one another.
        """
        self.pool.check()
        return as_array(self.pool.live(column))

    def check(self) -> None:
        """Check the buffers, which a user may have changed.

        Raises:
            ValueError: as `GrowableRows.check`, several floating-point types, or a sequence outside
                the pool.
        """
        for rows in self.children():
            if isinstance(rows, GrowableRows):
                rows.check()
        types = {buffer.dtype for buffer in self.buffers() if buffer.is_floating_point()}
        if len(types) > 1:
            raise ValueError(f"expected columns of one floating-point type, got {types}")
        start, length, capacity = map(self.blocks.live, ("start", "length", "capacity"))
        inside = (start >= 0) & (length >= 0) & (capacity >= length)
        if not bool((inside & (capacity <= len(self.pool) - start)).all()):
            raise ValueError(f"expected sequences within the {len(self.pool)} rows of the pool")

    def check_pair(self, targets: object, cues: object) -> None:
        """Raise a ValueError unless these are targets `[T, A]` and normalized cues `[T, D]`."""
        self.check()
        for name, rows in (("target", targets), ("cue", cues)):
            stored = self.pool.live(name)
            check_bounded(f"{name}s", rows, stored.shape[1], stored)

    def rows_in(self, column: str, sequence: int) -> Tensor:
        """Return a sequence's rows of a column, a view `[L, ...]`."""
        sequence = check_index("a schema", sequence, len(self.blocks))
        start, length = int(self.blocks.live("start")[sequence]), int(self.lengths[sequence])
        rows = self.pool.live(column)
        if not 0 <= start <= start + length <= len(rows):
            raise ValueError(f"expected schema {sequence} within the {len(rows)} rows of the pool")
        return rows[start : start + length]

    def append_rows(self, sequences: Tensor, counts: Tensor, rows: Mapping[str, Tensor]) -> None:
        """Append rows to several sequences.

        Args:
            sequences: which ones, int64 `[N]`, all different.
            counts: number of new rows of each, int64 `[N]`.
            rows: column -> values `[sum of counts, ...]`, one sequence after the other.
        """
        if len(self.pool) > 4 * max(8, int(self.blocks.live("capacity").sum())):
            compact(self)
        lengths = self.lengths[sequences]
        full = lengths + counts > self.blocks.live("capacity")[sequences]
        if bool(full.any()):
            self._move_to_end(sequences[full], (lengths + counts)[full])
        places = rows_of(self.blocks.live("start")[sequences] + lengths, counts)
        for name, values in rows.items():
            self.pool.live(name)[places] = values
        self.lengths[sequences] = lengths + counts

    def drop_first(self, sequences: Tensor, counts: Tensor) -> None:
        """Drop the first rows of several sequences.

        Args:
            sequences: which ones, int64 `[N]`, all different.
            counts: number of rows that each loses, int64 `[N]`, at most its length.
        """
        self.blocks.live("start")[sequences] += counts
        for column in ("length", "capacity"):
            self.blocks.live(column)[sequences] -= counts

    def _move_to_end(self, sequences: Tensor, wanted: Tensor) -> None:
        """Move sequences to the pool's end, each into a block of at least twice its length."""
        lengths = self.lengths[sequences]
        capacity = torch.maximum(2 * lengths, wanted).clamp(min=8)
        start = self.pool.extend(int(capacity.sum())) + capacity.cumsum(0) - capacity
        old, new = rows_of(self.blocks.live("start")[sequences], lengths), rows_of(start, lengths)
        for name in self.pool.columns:
            column = self.pool.live(name)
            column[new] = column[old]
        self.blocks.live("start")[sequences] = start
        self.blocks.live("capacity")[sequences] = capacity


def rows_of(starts: Tensor, counts: Tensor) -> Tensor:
    """Return the rows of blocks that start at `starts`, one block after the other, int64."""
    # The difference between a row and its index in the result.
    shift = torch.repeat_interleave(starts - (counts.cumsum(0) - counts), counts)
    return torch.arange(len(shift), device=shift.device) + shift


def compact(sequences: nn.Module, *_: object) -> None:
    """Lay the sequences end to end in the order of their ids, and drop rows of no sequence.

    Raises:
        ValueError: buffers that contradict one another.
    """
    assert isinstance(sequences, Sequences)
    Sequences.check(sequences)  # subclasses check more, which may not hold during an episode
    blocks, pool = sequences.blocks, sequences.pool
    lengths = blocks.live("length")
    starts = lengths.cumsum(0) - lengths
    if torch.equal(starts, blocks.live("start")) and int(lengths.sum()) == len(pool):
        if not torch.equal(blocks.live("capacity"), lengths):
            blocks.live("capacity").copy_(lengths)
        return
    pool.select(rows_of(blocks.live("start"), lengths))
    blocks.live("start").copy_(starts)
    blocks.live("capacity").copy_(lengths)
