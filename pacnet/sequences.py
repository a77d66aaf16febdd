"""Growable sequences of targets that share one pool, each target with the percept it goes with.

What both kinds of motor schemas are made of: one sequence per node (`MotorSchemas`) and several
that compete (`CompetingSchemas`).
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from pacnet.rows import Column, GrowableRows

NUMBER = Column((), torch.int64)
"""A column of integers."""


class Sequences(nn.Module):
    """Sequences of (target, cue) rows that lie in one pool, one contiguous block each.

    `blocks` says where each sequence starts, how long it is and how much room it has before it must
    move to the pool's end. So appending costs constant time on average, and a saved pool holds no
    gaps.

    Args:
        target_dimensions: length A of a target.
        cue_dimensions: length D of a cue.
        of_sequence: what else is kept of each sequence.
        of_row: what else is kept of each target.
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
            {"start": NUMBER, "length": NUMBER, "room": NUMBER, **of_sequence}
        )
        self.register_state_dict_pre_hook(close_gaps)

    @property
    def lengths(self) -> Tensor:
        """Number of targets of each sequence, int64 `[N]`."""
        return self.blocks.live("length")

    def targets(self, sequence: int) -> Tensor:
        """The sequence's targets in order, `[L, A]`."""
        return self._rows("target", sequence)

    def cues(self, sequence: int) -> Tensor:
        """The percepts, in the map's scaled units, that the targets were shown with, `[L, D]`."""
        return self._rows("cue", sequence)

    def _rows(self, column: str, sequence: int) -> Tensor:
        start, length = int(self.blocks.live("start")[sequence]), int(self.lengths[sequence])
        return self.pool.live(column)[start : start + length]

    def _append(self, sequence: int, row: Mapping[str, Tensor | int]) -> None:
        if self.lengths[sequence] == self.blocks.live("room")[sequence]:
            self._make_room(sequence)
        number = int(self.blocks.live("start")[sequence] + self.lengths[sequence])
        for name, value in row.items():
            self.pool.live(name)[number] = value
        self.lengths[sequence] += 1

    def _make_room(self, sequence: int) -> None:
        """Moves a sequence to the pool's end, into a block of twice the room."""
        if len(self.pool) > 4 * max(8, int(self.blocks.live("room").sum())):
            close_gaps(self)
        rows = {name: self._rows(name, sequence) for name in self.pool.columns}
        length = int(self.lengths[sequence])
        room = max(8, 2 * length)
        start = self.pool.extend(room)
        for name, old in rows.items():
            self.pool.live(name)[start : start + length] = old
        self.blocks.live("start")[sequence] = start
        self.blocks.live("room")[sequence] = room


def close_gaps(sequences: nn.Module, *_: object) -> None:
    """Lays the sequences end to end in the order of their numbers; what they hold stays.

    Rows of the pool are numbered anew, and none is left that belongs to no sequence.
    """
    assert isinstance(sequences, Sequences)
    blocks = sequences.blocks
    lengths = blocks.live("length")
    starts = lengths.cumsum(0) - lengths
    # Row of the pool for each place: its sequence's old start plus its place within the sequence.
    shift = torch.repeat_interleave(blocks.live("start") - starts, lengths)
    sequences.pool.keep(torch.arange(len(shift), device=shift.device) + shift)
    blocks.live("start").copy_(starts)
    blocks.live("room").copy_(lengths)
