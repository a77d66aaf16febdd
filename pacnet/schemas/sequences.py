"""Growable sequences of targets that share one pool, each target with the percept it goes with.

What both kinds of motor schemas are made of: one sequence per node (`MotorSchemas`) and several
that compete (`CompetingSchemas`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.records import NO_NODE
from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.core.validation import batch_of_one, check_bounded, check_number

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

    target: NDArray[np.floating]  # [A]
    position: int
    schema: int


class RecalledRows(NamedTuple):
    """The current targets at T samples; NaN, −1 and `NO_NODE` where there is none."""

    target: NDArray[np.floating]  # [T, A]
    position: NDArray[np.int64]  # [T]
    schema: NDArray[np.int64]  # [T]


class RecalledTargets(NamedTuple):
    """The current targets at T samples; NaN, −1 and `NO_NODE` where there is none."""

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
        self.register_state_dict_pre_hook(compact)

    def extra_repr(self) -> str:
        """Return how much is stored, for `print`."""
        width = self.pool.columns["target"].shape[0]
        return f"nodes={len(self)}, targets={int(self.lengths.sum())}, target_dimensions={width}"

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

    @torch.no_grad()
    def recall(self, node: int, percept: Tensor) -> RecalledTarget | None:
        """The current target of the winner; how it is found, each kind of schemas says.

        Args:
            node: the winner, or `NO_NODE`.
            percept: `[D]`, scaled.

        Returns:
            The target, with its place in its sequence; None if there is none.

        Raises:
            ValueError: no such node, or a percept of the wrong shape, dtype or device, or not
                finite.
        """
        node = self._check_winner(node)
        check_bounded("percept", batch_of_one(percept), *self._like_a_cue())
        recalled = self.recall_checked(node, as_array(percept))
        if recalled is None:
            return None
        target, position, schema = recalled
        return RecalledTarget(torch.from_numpy(target).to(percept), position, schema)

    @torch.no_grad()
    def recall_samples(self, nodes: Tensor, percepts: Tensor) -> RecalledTargets:
        """`recall` for winners, or `NO_NODE`, int64 `[T]`, and scaled percepts `[T, D]`.

        Raises:
            ValueError: no such node, not a percept for each, or a bad one.
        """
        check_bounded("percepts", percepts, *self._like_a_cue())
        if not isinstance(nodes, Tensor) or nodes.shape != (len(percepts),):
            got = list(nodes.shape) if isinstance(nodes, Tensor) else type(nodes).__name__
            raise ValueError(f"expected a node for each of {len(percepts)} percepts, got {got}")
        if nodes.dtype != torch.int64 or nodes.layout != torch.strided:
            raise ValueError(f"expected nodes as torch.int64, got {nodes.dtype} {nodes.layout}")
        self._check_winner(int(nodes.min()))
        self._check_winner(int(nodes.max()))
        recalled = self.recall_all(nodes.numpy(force=True), as_array(percepts))
        return RecalledTargets(
            torch.from_numpy(recalled.target).to(percepts),
            *(torch.from_numpy(number).to(percepts.device) for number in recalled[1:]),
        )

    def recall_all(self, nodes: NDArray[np.int64], percepts: NDArray[np.floating]) -> RecalledRows:
        """`recall_samples` of arrays that are checked."""
        targets = np.full((len(nodes), self.pool.live("target").shape[1]), np.nan, percepts.dtype)
        positions, schemas = np.full((2, len(nodes)), NO_NODE)
        for sample, node in enumerate(nodes.tolist()):
            recalled = self.recall_checked(node, percepts[sample])
            if recalled is not None:
                targets[sample], positions[sample], schemas[sample] = recalled
        return RecalledRows(targets, positions, schemas)

    def recall_checked(self, node: int, percept: NDArray[np.floating]) -> RecalledRow | None:
        """`recall` for a winner and a scaled percept `[D]` that are checked."""
        raise NotImplementedError

    def arrays(self, column: str) -> NDArray[Any]:
        """A column of the pool as an array; of the same memory, if that is possible.

        Raises:
            ValueError: buffers that contradict one another.
        """
        self.pool.check()
        return as_array(self.pool.live(column))

    def check(self) -> None:
        """Checks what a user may have done to the buffers, before anything relies on them.

        Raises:
            ValueError: as `GrowableRows.check`, or sequences that lie outside of the pool.
        """
        for rows in self.children():
            if isinstance(rows, GrowableRows):
                rows.check()
        types = {buffer.dtype for buffer in self.buffers() if buffer.is_floating_point()}
        if len(types) > 1:
            raise ValueError(f"expected columns of one floating-point type, got {types}")
        start, length, room = (self.blocks.live(name) for name in ("start", "length", "room"))
        inside = (start >= 0) & (length >= 0) & (room >= length) & (room <= len(self.pool) - start)
        if not bool(inside.all()):
            raise ValueError(f"expected sequences within the {len(self.pool)} rows of the pool")

    def check_pair(self, targets: object, cues: object) -> None:
        """Raises a ValueError unless these are targets `[T, A]` and scaled cues `[T, D]`."""
        self.pool.check()
        wanted = self.pool.live("target")
        check_bounded("targets", targets, wanted.shape[1], wanted)
        check_bounded("cues", cues, *self._like_a_cue())

    def _like_a_cue(self) -> tuple[int, Tensor]:
        self.check()
        cues = self.pool.live("cue")
        return cues.shape[1], cues

    def _check_winner(self, node: int) -> int:
        return check_number("a node", node, len(self), NO_NODE, f", {NO_NODE} for none")

    def __len__(self) -> int:
        """The number of nodes."""
        raise NotImplementedError

    def _rows(self, column: str, sequence: int) -> Tensor:
        sequence = check_number("a schema", sequence, len(self.blocks))
        start, length = int(self.blocks.live("start")[sequence]), int(self.lengths[sequence])
        rows = self.pool.live(column)
        if not 0 <= start <= start + length <= len(rows):
            raise ValueError(f"expected schema {sequence} within the {len(rows)} rows of the pool")
        return rows[start : start + length]

    def append_each(self, sequences: Tensor, counts: Tensor, rows: Mapping[str, Tensor]) -> None:
        """Appends rows to several sequences.

        Args:
            sequences: which, int64 `[N]`, none of them twice.
            counts: how many rows each gets, int64 `[N]`.
            rows: of each column a tensor `[sum of counts, ...]`, one sequence after the other.
        """
        if len(self.pool) > 4 * max(8, int(self.blocks.live("room").sum())):
            compact(self)  # before anything is told by how much room there is
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
        lengths = self.lengths[sequences]
        room = torch.maximum(2 * lengths, wanted).clamp(min=8)
        start = self.pool.extend(int(room.sum())) + room.cumsum(0) - room
        old, new = rows_of(self.blocks.live("start")[sequences], lengths), rows_of(start, lengths)
        for name in self.pool.columns:
            column = self.pool.live(name)
            column[new] = column[old]
        self.blocks.live("start")[sequences] = start
        self.blocks.live("room")[sequences] = room


def in_single(rows: Tensor) -> Tensor:
    """Half precision in float32, for what cannot be computed in it; all other rows as they are."""
    return rows.float() if rows.dtype in (torch.half, torch.bfloat16) else rows


def as_array(rows: Tensor) -> NDArray[Any]:
    """Rows as a contiguous array, of the same memory if they are that; half precision in single."""
    return in_single(rows.detach()).contiguous().numpy(force=True)


def rows_of(starts: Tensor, counts: Tensor) -> Tensor:
    """Numbers of the rows of blocks, one block after the other, int64 `[sum of counts]`.

    Args:
        starts: the first row of each block, int64 `[N]`.
        counts: rows of each, int64 `[N]`.
    """
    # To the place among all of them: what lies between it and its row.
    shift = torch.repeat_interleave(starts - (counts.cumsum(0) - counts), counts)
    return torch.arange(len(shift), device=shift.device) + shift


def compact(sequences: nn.Module, *_: object) -> None:
    """Lays the sequences end to end in the order of their numbers; what they hold stays.

    Rows of the pool are numbered anew, and none is left that belongs to no sequence. They move to
    other memory, unless there is no gap.

    Raises:
        ValueError: buffers that contradict one another.
    """
    assert isinstance(sequences, Sequences)
    Sequences.check(sequences)  # of more, nothing may hold while an episode is being learned
    blocks, pool = sequences.blocks, sequences.pool
    lengths = blocks.live("length")
    starts = lengths.cumsum(0) - lengths
    if torch.equal(starts, blocks.live("start")) and int(lengths.sum()) == len(pool):
        if not torch.equal(blocks.live("room"), lengths):
            blocks.live("room").copy_(lengths)
        return
    pool.select(rows_of(blocks.live("start"), lengths))
    blocks.live("start").copy_(starts)
    blocks.live("room").copy_(lengths)
