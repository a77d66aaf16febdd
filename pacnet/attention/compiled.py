"""The compiled engine of the growing map: hands its memory to the kernels and reads their record.

Imported only where it runs, for it brings numba.
"""

from __future__ import annotations

import operator
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention import kernels as kernels
from pacnet.attention.config import LARGEST_PERCEPT, SOFMConfig
from pacnet.attention.kernel_rules import rules_of
from pacnet.attention.records import Attention, MapUpdate, Observation, Step
from pacnet.core.growable_rows import GrowableRows, check_storage
from pacnet.kernels.threads import share_rows

_WORK = 2**27  # multiplications between two chances for a Ctrl-C, some 20 ms
_FEWEST_LISTED = 8  # edges of a node that a list has room for at least
_LARGEST = np.float32(LARGEST_PERCEPT)
_NO_NODE = np.zeros(0, np.int64)


class MapState(NamedTuple):
    """What of a map changes when it learns."""

    nodes: GrowableRows
    edges: GrowableRows
    buffers: dict[str, Tensor]  # "time", int64 [], and "scale", float32 [D]
    drop: Callable[[Tensor], object]  # deletes nodes, int64 [K] ascending


class _Record(NamedTuple):
    """What the kernels write down of T samples."""

    winner: NDArray[np.int64]  # [T]
    runner_up: NDArray[np.int64]  # [T]
    activation: NDArray[np.float32]  # [T]
    events: NDArray[np.uint8]  # [T], bits

    @classmethod
    def of(cls, samples: int) -> _Record:
        """Of so many samples, to be filled in."""
        winner, runner_up = np.empty((2, samples), np.int64)
        activation, events = np.empty(samples, np.float32), np.empty(samples, np.uint8)
        return cls(winner, runner_up, activation, events)


class CompiledSOFM:
    """Learns and reads in compiled kernels, for maps in float32 on the CPU.

    It keeps nothing of a map but lists of its edges, which the kernels make anew for another one.
    Threads that learn wait for one another, those that read do not.

    Args:
        config: of the maps.
    """

    def __init__(self, config: SOFMConfig) -> None:
        self.config = config
        self._rules = rules_of(config)
        self._learning = threading.RLock()
        self._novel_from = self._rules["novel_from"][0]
        self._counts = np.zeros(3, np.int64)
        self._listed = np.zeros((0, 2), np.int64)
        self._make_lists(0, _FEWEST_LISTED)
        self._percept = np.empty((1, config.dimensions), np.float32)
        self._one = _Record.of(1)
        self._buffers: tuple[Tensor, ...] = ()
        self._addresses: tuple[int, ...] = ()
        self._columns: tuple[NDArray[Any], ...] = ()
        self._lonely = np.zeros(1, np.int64)
        # What was read last: prototypes and scale, their addresses, and the arrays of both.
        self._read: tuple[Any, ...] = (None, None, 0, 0, None, None)

    def __reduce__(self) -> tuple[type[CompiledSOFM], tuple[SOFMConfig]]:
        """A copy looks up what it needs itself."""
        return CompiledSOFM, (self.config,)

    def learn(self, state: MapState, percepts: NDArray[np.float32]) -> MapUpdate:
        """Learns percepts in order of time, in place.

        Args:
            state: of the map.
            percepts: finite and scaled, `[T, D]`.

        Raises:
            ValueError: nodes or edges that contradict one another.
        """
        samples = len(percepts)
        record, gone, done = _Record.of(samples), [], 0
        deleted = np.zeros(samples, np.int64)
        with self._learning:
            while done < samples:
                at_once = _WORK // max(1, state.nodes.live("prototype").numel())
                done, lonely = self._learn(state, percepts[: done + max(1, at_once)], done, record)
                if len(lonely):
                    gone.append(torch.from_numpy(lonely))
                    deleted[done - 1] = len(lonely)
                    state.drop(gone[-1])
        numbers = torch.cat(gone) if gone else torch.zeros(0, dtype=torch.int64)
        return _as_lesson(record, torch.from_numpy(deleted), numbers)

    def step(self, state: MapState, percept: NDArray[np.float32]) -> Step | None:
        """Learns one percept `[D]`, in place; None if it is not finite or too large."""
        with self._learning:
            return self._step(state, percept)

    def _step(self, state: MapState, percept: NDArray[np.float32]) -> Step | None:
        _, factors = self._looked_up(state)
        if not kernels.scale_one(percept, factors, _LARGEST, self._percept):
            return None
        done, lonely = 0, ()
        while done == 0:
            done, lonely = self._learn(state, self._percept, 0, self._one)
        if len(lonely):
            state.drop(torch.from_numpy(lonely))
        one = self._one
        events = one.events.item()
        ignored = events & kernels.IGNORED != 0
        return Step(
            one.winner.item(), one.runner_up.item(), one.activation.item(),
            events & kernels.NOVEL != 0, not ignored, events & kernels.INSERTED != 0, ignored,
            events & kernels.DISHABITUATED != 0, len(lonely),
        )  # fmt: skip

    def look(
        self, state: MapState, percept: NDArray[np.float32]
    ) -> tuple[Step, NDArray[np.float32]] | None:
        """Reads one percept `[D]`: what a map in eval mode says of it, and the percept, scaled.

        None if it is not finite or too large.
        """
        (prototype, nodes), factors = self._looked_up(state)
        scaled = np.empty((1, len(percept)), np.float32)
        valid, winner, runner_up, activation, novelty = kernels.read_one(
            percept, factors, _LARGEST, prototype, nodes, self._novel_from, scaled
        )
        fields: Any = winner, runner_up, activation, novelty, False, False, True, False, 0
        step = Step._make(fields)
        return (step, scaled[0]) if valid else None

    def read(self, nodes: GrowableRows, percepts: Tensor) -> Attention:
        """Reads finite, scaled percepts `[B, D]`, without gradient, in as many threads as torch."""
        rows = np.ascontiguousarray(percepts.detach().numpy())
        count, (prototype, number) = len(rows), nodes.transposed("prototype")
        if rows.shape[1] != len(prototype):
            raise ValueError(
                f"expected percepts of {len(prototype)} dimensions, as prototypes have, "
                f"got {rows.shape[1]}"
            )
        winner, runner_up = np.empty((2, count), np.int64)
        activation, novelty = np.empty(count, np.float32), np.empty(count, np.bool_)
        answers = winner, runner_up, activation, novelty

        def read(start: int, stop: int) -> None:
            own = (answer[start:stop] for answer in answers)
            kernels.read(rows[start:stop], prototype, number, self._novel_from, *own)

        share_rows(read, count, work=count * number * rows.shape[1])
        return Attention(*map(torch.from_numpy, answers))

    def _learn(
        self, state: MapState, percepts: NDArray[np.float32], start: int, record: _Record
    ) -> tuple[int, NDArray[np.int64]]:
        """One call of the kernel: the number of the next sample, and nodes to be dropped."""
        columns, lonely = self._arrays(state), self._lonely
        before = self._counts.tolist()
        learn: Any = kernels.learn  # a type checker counts the columns as one argument
        try:
            done, status, nodes, edges = learn(
                percepts, start, *columns, self._lists, self._degree, self._listed, self._counts,
                self._rules, *record, lonely,
            )  # fmt: skip
        except BaseException:  # a Ctrl-C on the way back: what was written is not shown
            self._buffers = ()
            raise
        if nodes != before[kernels.NODES] or edges != before[kernels.EDGES]:
            state.nodes.set_length(nodes)
            state.edges.set_length(edges)
            self._hold(state)
        if status == kernels.DONE:
            return done, _NO_NODE
        if status == kernels.LONELY:
            return done, np.sort(lonely[: lonely[-1]])
        if status == kernels.INVALID:
            raise ValueError(
                f"expected percepts of {len(columns[0])} dimensions, and edges between two of "
                f"{nodes} nodes each, got others"
            )
        if [nodes, edges] == before[: kernels.LISTED] and done == start:  # a list is full
            self._make_lists(len(self._lists), 2 * self._lists.shape[1])
        return done, _NO_NODE

    def _arrays(self, state: MapState) -> tuple[NDArray[Any], ...]:
        """The map's columns with room for a node and two edges more, and its time, as arrays.

        They are looked up anew when one of them has moved, or there is no room.

        Raises:
            ValueError: buffers of other shapes or types, or of unequal length.
        """
        columns, counts = self._columns, self._counts
        if self._holds(state):
            nodes, edges, _ = counts.tolist()
            if nodes < columns[0].shape[1] and edges + 2 <= len(columns[4]):
                return columns
        # Made inside a caller's inference mode they would be buffers nobody can update later.
        with torch.inference_mode(False):
            of_nodes, of_edges = state.nodes.arrays(1), state.edges.arrays(2)
        time = array_of(state.buffers["time"]).reshape(1)
        if time.dtype != np.int64:
            raise ValueError(f"expected time as torch.int64, got {time.dtype}")
        self._columns = columns = (*of_nodes.values(), *of_edges.values(), time)
        self._hold(state)
        counts[: kernels.LISTED] = len(state.nodes), len(state.edges)
        room = of_nodes["prototype"].shape[-1]
        if len(self._lists) != room:
            self._make_lists(room, self._lists.shape[1])
            self._lonely = np.zeros(room + 1, np.int64)
        if len(self._listed) != len(of_edges["age"]):
            self._listed = np.zeros((len(of_edges["age"]), 2), np.int64)
            counts[kernels.LISTED] = kernels.NOT_LISTED
        return columns

    def _make_lists(self, nodes: int, longest: int) -> None:
        """Empty ones, for so many nodes and so many edges of each."""
        self._lists = np.zeros((nodes, longest), np.int64)
        self._degree = np.zeros(nodes, np.int64)
        self._counts[kernels.LISTED] = kernels.NOT_LISTED

    def _hold(self, state: MapState) -> None:
        """Notes which buffers the arrays are of."""
        self._buffers = _buffers_of(state)
        self._addresses = tuple(map(Tensor.data_ptr, self._buffers))

    def _holds(self, state: MapState) -> bool:
        """Whether these are the buffers that were looked up last, where they were."""
        buffers = _buffers_of(state)
        same = all(map(operator.is_, buffers, self._buffers))
        return same and self._addresses == tuple(map(Tensor.data_ptr, buffers))

    def _looked_up(self, state: MapState) -> tuple[tuple[NDArray[Any], int], NDArray[Any]]:
        """Prototypes and scale as arrays, looked up anew when they are others, or have moved."""
        read, scale = self._read, state.buffers["scale"]
        prototype: Any = state.nodes._buffers["prototype"]
        same = read[0] is prototype and read[1] is scale
        if same and read[2] == prototype.data_ptr() and read[3] == scale.data_ptr():
            return read[4], read[5]
        if prototype.dim() != 2 or scale.dim() != 1 or scale.dtype != torch.float32:
            raise ValueError(
                f"expected prototypes [nodes, D] and a float32 scale [D], got "
                f"{list(prototype.shape)} and {scale.dtype} {list(scale.shape)}"
            )
        nodes, factors = state.nodes.transposed("prototype"), array_of(scale)
        if nodes[0].ctypes.data == prototype.data_ptr() and scale.is_contiguous():  # no copies
            self._read = prototype, scale, prototype.data_ptr(), scale.data_ptr(), nodes, factors
        return nodes, factors


def _buffers_of(state: MapState) -> tuple[Any, ...]:
    return *state.nodes._buffers.values(), *state.edges._buffers.values(), state.buffers["time"]


def array_of(tensor: Tensor) -> NDArray[Any]:
    """A tensor on the CPU as an array of the same memory, contiguous, or else of a copy.

    Raises:
        ValueError: a tensor whose storage is gone.
    """
    check_storage("tensor", tensor)
    return tensor.detach().contiguous().numpy()


def _as_lesson(record: _Record, deleted: Tensor, gone: Tensor) -> MapUpdate:
    novelty, inserted, ignored, dishabituated, habituated = (
        torch.from_numpy((record.events & event) != 0)
        for event in (
            kernels.NOVEL, kernels.INSERTED, kernels.IGNORED,
            kernels.DISHABITUATED, kernels.HABITUATED,
        )
    )  # fmt: skip
    observation = Observation(
        winner=torch.from_numpy(record.winner),
        runner_up=torch.from_numpy(record.runner_up),
        activation=torch.from_numpy(record.activation),
        novelty=novelty,
        attended=~ignored,
        inserted=inserted,
        ignored=ignored,
        dishabituated=dishabituated,
        deleted=deleted,
    )
    return MapUpdate(observation, habituated, gone)
