"""Growable sequences of targets that share one pool, each target with the percept it goes with.

What both kinds of motor schemas are made of: one sequence per node (`MotorSchemas`) and several
that compete (`CompetingSchemas`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention import NOBODY
from pacnet.rows import Column, GrowableRows

NUMBER = Column((), torch.int64)
"""A column of integers."""


class Samples(NamedTuple):
    """T samples of an episode, in order of time, as the map hands them to the motor schemas."""

    node: Tensor
    """The winner, int64 `[T]`; what it is matters only where it is habituated."""
    activation: Tensor
    """Of the winner by the percept, `[T]`."""
    habituated: Tensor
    """Whether the winner is fully habituated, bool `[T]`."""
    target: Tensor
    """`[T, A]`."""
    cue: Tensor
    """The percept, scaled, `[T, D]`."""


class RecalledTarget(NamedTuple):
    """The current target of a motor schema."""

    target: Tensor  # [A]
    position: int  # its place in its sequence; of several, that of the nearest cue
    schema: int  # number of the sequence


class RecalledRow(NamedTuple):
    """The same as a `RecalledTarget`, for a control loop."""

    target: NDArray[np.float32]  # [A]
    position: int
    schema: int


class RecalledTargets(NamedTuple):
    """The current targets at T samples; NaN, −1 and `NOBODY` where there is none."""

    target: Tensor  # [T, A]
    position: Tensor  # int64 [T]
    schema: Tensor  # int64 [T]


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

    def recall(self, node: int, percept: Tensor) -> RecalledTarget | None:
        """The current target at a sample; what it is, each kind of schemas decides."""
        raise NotImplementedError

    def recall_samples(self, nodes: Tensor, percepts: Tensor) -> RecalledTargets:
        """`recall` for winners, or `NOBODY`, int64 `[T]`, and scaled percepts `[T, D]`."""
        targets = self.pool.live("target")
        target = targets.new_full((len(nodes), targets.shape[1]), torch.nan)
        position = torch.full_like(nodes, NOBODY)
        schema = position.clone()
        for sample, node in enumerate(nodes.tolist()):
            recalled = self.recall(node, percepts[sample])
            if recalled is not None:
                target[sample], position[sample], schema[sample] = recalled
        return RecalledTargets(target, position, schema)

    def recall_row(self, node: int, percept: NDArray[np.float32]) -> RecalledRow | None:
        """`recall` for a scaled percept `[D]` that is no tensor."""
        recalled = self.recall(node, torch.from_numpy(percept).to(self.pool.live("cue")))
        if recalled is None:
            return None
        return RecalledRow(recalled.target.numpy(force=True), recalled.position, recalled.schema)

    def _rows(self, column: str, sequence: int) -> Tensor:
        start, length = int(self.blocks.live("start")[sequence]), int(self.lengths[sequence])
        return self.pool.live(column)[start : start + length]

    def append_each(self, sequences: Tensor, counts: Tensor, rows: Mapping[str, Tensor]) -> None:
        """Appends rows to several sequences.

        Args:
            sequences: which, int64 `[N]`, none of them twice.
            counts: how many rows each gets, int64 `[N]`.
            rows: of each column a tensor `[sum of counts, ...]`, one sequence after the other.
        """
        lengths = self.lengths[sequences]
        full = lengths + counts > self.blocks.live("room")[sequences]
        if bool(full.any()):
            self._make_room(sequences[full], (lengths + counts)[full])
        places = rows_of(self.blocks.live("start")[sequences] + lengths, counts)
        for name, values in rows.items():
            self.pool.live(name)[places] = values
        self.lengths[sequences] = lengths + counts

    def _make_room(self, sequences: Tensor, wanted: Tensor) -> None:
        """Moves sequences to the pool's end, each into a block of at least twice the room."""
        if len(self.pool) > 4 * max(8, int(self.blocks.live("room").sum())):
            close_gaps(self)
        lengths = self.lengths[sequences]
        room = torch.maximum(2 * lengths, wanted).clamp(min=8)
        start = self.pool.extend(int(room.sum())) + room.cumsum(0) - room
        old, new = rows_of(self.blocks.live("start")[sequences], lengths), rows_of(start, lengths)
        for name in self.pool.columns:
            column = self.pool.live(name)
            column[new] = column[old]
        self.blocks.live("start")[sequences] = start
        self.blocks.live("room")[sequences] = room


def rows_of(starts: Tensor, counts: Tensor) -> Tensor:
    """Numbers of the rows of blocks, one block after the other, int64 `[sum of counts]`.

    Args:
        starts: the first row of each block, int64 `[N]`.
        counts: rows of each, int64 `[N]`.
    """
    # To the place among all of them: what lies between it and its row.
    shift = torch.repeat_interleave(starts - (counts.cumsum(0) - counts), counts)
    return torch.arange(len(shift), device=shift.device) + shift


def close_gaps(sequences: nn.Module, *_: object) -> None:
    """Lays the sequences end to end in the order of their numbers; what they hold stays.

    Rows of the pool are numbered anew, and none is left that belongs to no sequence.
    """
    assert isinstance(sequences, Sequences)
    blocks = sequences.blocks
    lengths = blocks.live("length")
    sequences.pool.keep(rows_of(blocks.live("start"), lengths))
    blocks.live("start").copy_(lengths.cumsum(0) - lengths)
    blocks.live("room").copy_(lengths)
