"""What was shown: every demonstration as one motor schema, a sequence of targets with percepts.

A motor schema "recalls the current internal target" (Maistros, Marom & Hayes 2001): which one is
current is a matter of the percept and of the position in the sequence
(`pacnet.competition.following`). Nothing that was shown is dropped unless memory is bounded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.drafts import BufferVersions, adopt, snapshot_of
from pacnet.core.growable_rows import Column, GrowableRows, as_array
from pacnet.core.integrity import (
    are_bounded,
    check_conditions,
    check_on_load,
    check_structure,
    within,
)
from pacnet.schemas.interpolation import durations, interpolated, played

_LEAF = 32  # frames in a box
_MOST_FRAMES = 2**24  # of a demonstration: 4 days at 50 frames per second
_INTEGER = Column((), torch.int64)


class Shown(NamedTuple):
    """All demonstrations, as arrays for kernels. R frames, E demonstrations, C boxes of frames.

    The frames of a demonstration lie one after the other, and so do its boxes.
    """

    percepts: NDArray[np.float32]
    """Scaled, `[R, D]`."""
    changes: NDArray[np.float32]
    """How the percept has changed lately, scaled, `[R, D]`; see `pacnet.schemas.changes`."""
    targets: NDArray[np.float32]
    """`[R, A]`."""
    time: NDArray[np.int64]
    """Number of each frame in its demonstration as it is followed, ascending, `[R]`."""
    frame: NDArray[np.int64]
    """Number of each frame in its demonstration as it was shown, ascending, `[R]`."""
    first: NDArray[np.int64]
    """The first row of each demonstration, and the end of the last one, `[E + 1]`."""
    frames: NDArray[np.int64]
    """Number of frames of each demonstration, whether they are kept or not, `[E]`."""
    pace: NDArray[np.float64]
    """Mean distance from one frame to the next, scaled, `[E]`."""
    task: NDArray[np.int64]
    """Number of the task that each demonstration shows, `[E]`."""
    correction: NDArray[np.bool_]
    """Whether each showed what to do where all was novel, `[E]`."""
    box_first: NDArray[np.int64]
    """The first row in each box, and the end of the last one, `[C + 1]`."""
    box_of: NDArray[np.int64]
    """The first box of each demonstration, and the end of the last one's, `[E + 1]`."""
    low: NDArray[np.float32]
    """Lower corner of the box around the percepts of a few successive frames, `[C, D]`."""
    high: NDArray[np.float32]
    """Its upper corner."""


class DemonstrationMemory(nn.Module):
    """A store of demonstrations, which grows in amortised constant time for each frame.

    Args:
        percept_dimensions: length D of a percept.
        target_dimensions: length A of a target.
    """

    def __init__(self, percept_dimensions: int, target_dimensions: int) -> None:
        super().__init__()
        row = Column((percept_dimensions,), torch.float32)
        target = Column((target_dimensions,), torch.float32)
        self.rows = GrowableRows(
            {"percept": row, "change": row, "target": target, "time": _INTEGER}
        )
        self.demonstrations = GrowableRows(
            {
                "rows": _INTEGER,  # that are kept
                "frames": _INTEGER,  # that were shown
                "task": _INTEGER,
                "correction": _INTEGER,  # 1 for one that showed what to do where all was novel
                "pace": Column((), torch.float32),
            }
        )
        self._shown: Shown | None = None
        self._whole: tuple[Shown, Shown] | None = None  # of what is kept, and with all frames
        self._versions: BufferVersions | None = None
        check_on_load(self)

    def __len__(self) -> int:
        """Return the number of demonstrations."""
        return len(self.demonstrations)

    def append(
        self,
        percepts: NDArray[np.float32],
        changes: NDArray[np.float32],
        targets: NDArray[np.float32],
        task: int,
        correction: bool,
    ) -> None:
        """Keep one demonstration of T frames; arguments as the fields of `Shown`."""
        shown, count = self.shown(), len(percepts)
        steps = np.linalg.norm(np.diff(percepts, axis=0).astype(np.float64), axis=1)
        pace = float(steps.mean()) if len(steps) else 0.0
        time = np.arange(count)
        rows = {"percept": percepts, "change": changes, "target": targets, "time": time}
        _append(self.rows, count, rows)
        of = {"rows": count, "frames": count, "task": task, "correction": correction, "pace": pace}
        _append(self.demonstrations, 1, of)
        self._keep(_with_one_more(shown, self._arrays(), percepts))

    def select(
        self, rows: NDArray[np.bool_], last: Mapping[str, NDArray[np.float32]] | None = None
    ) -> None:
        """Keep only some rows, bool `[R]`; each demonstration keeps its place, even without any.

        Args:
            rows: which of them are kept.
            last: name of a column -> its values at the last rows that are kept.
        """
        kept = np.diff(np.r_[0, np.cumsum(rows)][self.shown().first])
        self.rows.select(torch.from_numpy(rows.nonzero()[0]))
        for name, values in (last or {}).items():
            self.rows.live(name)[len(self.rows) - len(values) :] = torch.from_numpy(values)
        self.demonstrations.copy_memory()  # a thread that reads them sees them unchanged
        self.demonstrations.live("rows").copy_(torch.from_numpy(kept))
        self._shown = None

    def shown(self) -> Shown:
        """Return what is kept, as arrays that later demonstrations do not change.

        Raises:
            ValueError: buffers that were changed from outside and contradict one another.
        """
        shown, versions = self._shown, self._versions
        if shown is None or versions is None or not versions.unchanged():
            self.check_state(self.state_dict())
            shown = self._keep(with_boxes(self._arrays()))
        return shown

    def whole(self) -> Shown:
        """Return the demonstrations with all frames, as they are followed; see `interpolated`.

        Raises:
            ValueError: as `shown`.
        """
        shown = self.shown()
        if self._whole is None or self._whole[0] is not shown:
            whole = interpolated(shown)
            self._whole = shown, whole if whole is shown else with_boxes(whole)
        return self._whole[1]

    @staticmethod
    def frames_of(tensors: Mapping[str, Tensor]) -> NDArray[np.int64]:
        """Return how many frames `whole` has of each demonstration in a checked state, `[E]`."""
        names = "rows.percept", "rows.time", "demonstrations.rows"
        percepts, frame, rows = (as_array(tensors[name]) for name in names)
        return played(durations(percepts, frame, rows), rows)

    def snapshot(self) -> DemonstrationMemory:
        """Return a memory with the same rows, to which more may be appended."""
        shown, other = self.shown(), snapshot_of(self)
        other._versions, other._shown = self._versions, shown
        return other

    def fork(self) -> DemonstrationMemory:
        """Return a memory that shares what is kept; what either learns is not the other's."""
        widths = (self.rows.columns[name].shape[0] for name in ("percept", "target"))
        shown, other = self.shown(), DemonstrationMemory(*widths)
        other.rows, other.demonstrations = self.rows.fork(), self.demonstrations.fork()
        other.train(self.training)
        other._keep(shown)
        return other

    def adopt(self, draft: DemonstrationMemory) -> None:
        """Replace the state by that of a draft, a snapshot to which demonstrations were added."""
        adopt(self, draft)
        if self._shown is not None:
            self._keep(self._shown)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out of copies what is derived from the rows."""
        return {**self.__dict__, "_shown": None, "_whole": None, "_versions": None}

    def _keep(self, shown: Shown) -> Shown:
        self._versions, self._shown = BufferVersions(self), shown
        return shown

    def _arrays(self) -> Shown:
        """Return the arrays without boxes; those that index others are copies."""
        rows = {name: self.rows.live(name).numpy() for name in self.rows.columns}
        of = {name: self.demonstrations.live(name) for name in self.demonstrations.columns}
        own = {name: column.numpy().copy() for name, column in of.items()}
        none, box = np.zeros(1, np.int64), np.zeros((0, rows["percept"].shape[1]), np.float32)
        return Shown(
            rows["percept"], rows["change"], rows["target"], rows["time"], rows["time"],
            np.r_[0, np.cumsum(own["rows"])], own["frames"], own["pace"].astype(np.float64),
            own["task"], own["correction"] > 0,
            none, none, box, box,
        )  # fmt: skip

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        rows, frames = tensors["demonstrations.rows"], tensors["demonstrations.frames"]
        time, kept = tensors["rows.time"], len(tensors["rows.time"])
        enough = bool((rows >= 0).all() and (rows <= frames).all()) and int(rows.sum()) == kept
        check_conditions({"as many rows as demonstrations have": enough})
        ends = torch.repeat_interleave(frames, rows)
        begins = torch.zeros(kept, dtype=torch.bool)
        begins[(rows.cumsum(0) - rows)[rows > 0]] = True
        pace = tensors["demonstrations.pace"]
        check_conditions(
            {
                "bounded percepts": are_bounded(tensors["rows.percept"]),
                "bounded changes": are_bounded(tensors["rows.change"]),
                "finite targets": tensors["rows.target"].isfinite().all(),
                f"at most {_MOST_FRAMES} frames": (frames <= _MOST_FRAMES).all(),
                "frames of their demonstrations": within(time, ends),
                "frames in order of time": bool(((time.diff() > 0) | begins[1:]).all()),
                "tasks ≥ 0": (tensors["demonstrations.task"] >= 0).all(),
                "corrections or none": within(tensors["demonstrations.correction"], 2),
                "a pace ≥ 0": ((pace >= 0) & pace.isfinite()).all(),
            }
        )


def _append(rows: GrowableRows, count: int, values: Mapping[str, Any]) -> None:
    """Append rows; torch sees no change of the memory, which snapshots share."""
    first, arrays = len(rows), rows.arrays(count)
    for name, value in values.items():
        arrays[name][first : first + count] = value
    rows.set_length(first + count)


def with_boxes(shown: Shown) -> Shown:
    """Return the arrays with boxes around all of their frames."""
    begins = [
        np.arange(first, end, _LEAF)
        for first, end in zip(shown.first[:-1], shown.first[1:], strict=True)
    ]
    box_first = np.concatenate([*begins, [len(shown.percepts)]]).astype(np.int64)
    box_of = np.r_[0, np.cumsum([len(begin) for begin in begins], dtype=np.int64)]
    low, high = _corners(shown.percepts, box_first[:-1])
    return shown._replace(box_first=box_first, box_of=box_of, low=low, high=high)


def _with_one_more(before: Shown, arrays: Shown, percepts: NDArray[np.float32]) -> Shown:
    """Return the arrays with the boxes of before, and those of one more demonstration."""
    begins = np.arange(0, len(percepts), _LEAF)
    low, high = _corners(percepts, begins)
    box_first = np.concatenate(
        [before.box_first[:-1], before.first[-1] + begins, [len(arrays.percepts)]]
    )
    return arrays._replace(
        box_first=box_first.astype(np.int64),
        box_of=np.append(before.box_of, before.box_of[-1] + len(begins)),
        low=np.concatenate([before.low, low]),
        high=np.concatenate([before.high, high]),
    )


def _corners(
    percepts: NDArray[np.float32], begins: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the corners `[C, D]` of the boxes that begin at these rows."""
    if len(begins) == 0:
        return percepts[:0], percepts[:0]
    return np.minimum.reduceat(percepts, begins), np.maximum.reduceat(percepts, begins)
