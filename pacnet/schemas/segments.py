"""Motor schemas in frames of reference: each demonstration's segments, a landmark each.

A segment is a sequence of targets on the way to one landmark. Its targets are places relative to
that landmark, and turned with it, so that what was shown at an object is known wherever it stands.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.drafts import BufferVersions
from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.core.integrity import check_conditions, check_on_load, check_structure, within

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
NO_SEGMENT = -1

WHOLE, CONTINUES, MIDDLE = 0, 1, 2
"""How a demonstration begins: with its episode, as the part after a gap of the demonstration before
it, or somewhere in the middle of its task, such as a correction."""


class Segments(NamedTuple):
    """All segments, for kernels. R frames, S segments, P points, M = P − 1 landmarks, U actions.

    Rows are those of the demonstrations, one after the other.
    """

    first: Numbers
    """The first row of each segment, `[S]`."""
    end: Numbers
    """The row after its last one, `[S]`."""
    landmark: Numbers
    """Number of its landmark, −1 for none, the world, `[S]`."""
    demonstration: Numbers
    """Number of its demonstration, `[S]`."""
    order: Numbers
    """Its number in the chain of demonstrations, the parts of one episode, `[S]`."""
    leg: Numbers
    """Number of its leg in the chain, or one of the marks in `pacnet.schemas.chains`, `[S]`."""
    after: Numbers
    """The next segment of the chain, `NO_SEGMENT` after the last one of the task, `[S]`."""
    usual: NDArray[np.bool_]
    """Whether its chain goes where most of its task go, and is not cut off, `[S]`."""
    layout: Array
    """How the scene looks at its beginning, `[S, F]`; see `pacnet.schemas.layout_kernels`."""
    places: Array
    """Of all points, smoothed, `[R, P, 3]`."""
    turns: Array
    """Of all points, `[R, P, 4]`."""
    place: Array
    """Of what is moved, seen from the landmark, `[R, 3]`."""
    turn: Array
    """Of what is moved, relative to the landmark's, `[R, 4]`."""
    velocity: Array
    """Change of its pose from the last frame, in the landmark's axes, `[R, 6]`."""
    axes: Array
    """How the landmark is turned, `[R, 4]`."""
    share: Array
    """Share of the segment's path that is over, `[R]`."""
    action: Array
    """Smoothed; relative to the place where an action is a place, `[R, U]`."""
    others: Array
    """What is perceived beside points, in shares of its range, `[R, Q]`."""
    carried: NDArray[np.bool_]
    """Whether each landmark moves, `[R, M]`."""
    moved: Numbers
    """What is moved to the landmark, `[S]`: the moved point, 0, or with a body the landmark that it
    carries, its number + 1."""
    turned: Numbers
    """Whose turn is wanted: that of what is moved, or the moved point's, 0, where it is not
    perceived how that is turned, `[S]`."""
    about_axis: NDArray[np.bool_]
    """Whether only how its third axis points is known of how that is turned, `[S]`."""
    goal: Array
    """With a body, where its hand or what it carries is to be, seen from the landmark, `[R, 3]`."""
    goal_turn: Array
    """With a body, how that is to be turned, relative to the landmark, `[R, 4]`."""

    def chain_around(self, segment: int) -> tuple[int, int]:
        """Return the first segment of a segment's chain, and the one after its last one."""
        later = np.flatnonzero(self.order[segment + 1 :] == 0)
        end = segment + 1 + later[0].item() if len(later) else len(self.order)
        return segment - self.order[segment].item(), end


class SegmentMemory(nn.Module):
    """A store of where demonstrations are cut, which grows in amortised constant time.

    Args:
        landmarks: number M of landmarks.
    """

    def __init__(self, landmarks: int) -> None:
        super().__init__()
        self.landmarks = landmarks
        column = Column((), torch.int64)
        names = ("demonstration", "frames", "landmark", "begins")
        self.rows = GrowableRows(dict.fromkeys(names, column))
        check_on_load(self)

    def append(self, demonstration: int, landmarks: Numbers, begins: int = WHOLE) -> None:
        """Keep the cut of one demonstration.

        Args:
            demonstration: its number.
            landmarks: of each of its frames, `[T]`.
            begins: `WHOLE`, `CONTINUES` or `MIDDLE`.
        """
        cuts = np.flatnonzero(np.diff(landmarks)) + 1
        first = np.r_[0, cuts]
        frames = np.diff(np.r_[first, len(landmarks)])
        begin, arrays = len(self.rows), self.rows.arrays(len(first))
        end = begin + len(first)
        arrays["demonstration"][begin:end] = demonstration
        arrays["frames"][begin:end] = frames
        arrays["landmark"][begin:end] = landmarks[first]
        arrays["begins"][begin:end] = begins
        self.rows.set_length(end)

    def columns(self) -> dict[str, Numbers]:
        """Return a copy of what is kept of each segment, by name, `[S]` each."""
        return {name: self.rows.live(name).numpy().copy() for name in self.rows.columns}

    def begins(self, demonstrations: int) -> Numbers:
        """Return how each of E demonstrations begins, `[E]`; see `append`. `WHOLE` without cuts."""
        out = np.full(demonstrations, WHOLE)
        out[self.rows.live("demonstration").numpy()] = self.rows.live("begins").numpy()
        return out

    def clear(self) -> None:
        """Forget all cuts."""
        self.rows.select(torch.empty(0, dtype=torch.int64))

    def versions(self) -> BufferVersions:
        """Return a record of the state, to detect later that it was changed."""
        return BufferVersions(self)

    def check_cuts(self, frames: Numbers, columns: Mapping[str, Numbers] | None = None) -> None:
        """Raise a ValueError unless each of the demonstrations, of `[E]` frames, is cut whole.

        Args:
            frames: of each demonstration.
            columns: as `columns` returns them, whose numbers are ≥ 0; None for those kept here.
        """
        columns = self.columns() if columns is None else columns
        cut = np.zeros(len(frames), np.int64)
        known = (columns["demonstration"] < len(frames)).all()
        if known:
            np.add.at(cut, columns["demonstration"], columns["frames"])
        check_conditions(
            {"segments of whole demonstrations": bool(known and (cut == frames).all())}
        )

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        demonstration, frames = tensors["rows.demonstration"], tensors["rows.frames"]
        begins, alike = tensors["rows.begins"], demonstration.diff() == 0
        check_conditions(
            {
                "demonstrations in order": bool(
                    (demonstration >= 0).all() and (demonstration.diff() >= 0).all()
                ),
                "segments of frames": (frames > 0).all(),
                "landmarks there are": within(tensors["rows.landmark"] + 1, self.landmarks + 1),
                "beginnings there are": within(begins, MIDDLE + 1)
                and not (begins[:1] == CONTINUES).any()
                and not (begins.diff()[alike] != 0).any(),
            }
        )
