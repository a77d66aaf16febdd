"""The compiled engine of the growing map: passes the map's buffers to the kernels.

Imported only where it runs, as it imports numba.
"""

from __future__ import annotations

import operator
import threading
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention import kernels
from pacnet.attention.config import SOFMConfig
from pacnet.attention.eager import activate
from pacnet.attention.edge_kernels import EDGES, FULL, INVALID, ISOLATED, LISTED, NODES, NOT_LISTED
from pacnet.attention.kernel_records import Record, map_update, rules_of
from pacnet.attention.records import Attention, MapUpdate, Step
from pacnet.attention.state import MapState
from pacnet.core.growable_rows import GrowableRows, check_storage
from pacnet.core.validation import MAX_VALUE, describe
from pacnet.kernels.threads import share_rows

_WORK = 2**27  # multiplications in one call, some 20 ms: a Ctrl-C waits for its end
_MIN_LIST = 8  # capacity of a node's list of edges
_LARGEST = np.float32(MAX_VALUE)
_NO_NODES = np.zeros(0, np.int64)


class CompiledEngine:
    """The rule of the map in compiled kernels, for maps in float32 on the CPU.

    Between calls it keeps only the lists of each node's edges, which the kernels check and rebuild
    for another map. Threads that learn wait for one another; threads that read do not.

    Args:
        config: of the maps.
    """

    def __init__(self, config: SOFMConfig) -> None:
        self.config = config
        self._rules = rules_of(config)
        self._novel_from = self._rules["novel_from"][0]
        self._learning = threading.RLock()
        self._percept, self._one = np.empty((1, config.dimensions), np.float32), Record.empty(1)
        # The buffers that learned last, their addresses, and arrays of the same memory.
        self._buffers: tuple[Tensor, ...] = ()
        self._addresses: tuple[int, ...] = ()
        self._columns: tuple[NDArray[Any], ...] = ()
        # Working memory of `kernels.learn`.
        self._counts = np.zeros(3, np.int64)
        self._listed_ends = np.zeros((0, 2), np.int64)
        self._isolated = np.zeros(1, np.int64)
        self._make_lists(0, _MIN_LIST)
        # Prototypes and scale that were read last, their addresses, and the arrays of both.
        self._last_read: tuple[Any, ...] = (None, None, 0, 0, None, None)

    def __reduce__(self) -> tuple[type[CompiledEngine], tuple[SOFMConfig]]:
        """Copy the config alone."""
        return CompiledEngine, (self.config,)

    def read(self, nodes: GrowableRows, percepts: Tensor) -> Attention:
        """Read normalized percepts `[B, D]`, in as many threads as torch uses."""
        rows = np.ascontiguousarray(percepts.detach().numpy())
        count, (prototype, number) = len(rows), nodes.transposed("prototype")
        if rows.shape[1] != len(prototype):
            wanted = f"percepts of {len(prototype)} dimensions, as prototypes have"
            raise ValueError(f"expected {wanted}, got {rows.shape[1]}")
        winner, runner_up = np.empty((2, count), np.int64)
        columns = winner, runner_up, np.empty(count, np.float32), np.empty(count, np.bool_)

        def read(start: int, stop: int) -> None:
            part = (column[start:stop] for column in columns)
            kernels.read(rows[start:stop], prototype, number, self._novel_from, *part)

        share_rows(read, count, work=count * number * rows.shape[1])
        attention = Attention(*map(torch.from_numpy, columns))
        if torch.is_grad_enabled() and percepts.requires_grad and number > 0:
            prototypes, threshold = nodes.live("prototype"), self.config.novelty_threshold
            return activate(percepts, prototypes, *attention[:2], threshold)
        return attention

    def read_one(
        self, state: MapState, percept: NDArray[np.float32]
    ) -> tuple[Step, NDArray[np.float32]] | None:
        """Read one percept `[D]` as in eval mode; return also the normalized percept.

        Returns None if the percept is not finite or too large.
        """
        (prototype, nodes), scale = self._arrays_to_read(state)
        normalized = np.empty((1, len(percept)), np.float32)
        valid, winner, runner_up, activation, novelty = kernels.read_one(
            percept, scale, _LARGEST, prototype, nodes, self._novel_from, normalized
        )
        fields: Any = winner, runner_up, activation, novelty, False, False, True, False, 0
        step = Step._make(fields)
        return (step, normalized[0]) if valid else None

    def learn(self, state: MapState, percepts: Tensor) -> MapUpdate:
        """Learn normalized percepts `[T, D]` in order of time, in place.

        Raises:
            ValueError: nodes or edges that contradict one another.
        """
        rows = np.ascontiguousarray(percepts.detach().numpy())
        record, deleted, done = Record.empty(len(rows)), {}, 0
        with self._learning:
            while done < len(rows):
                at_once = _WORK // max(1, state.nodes.live("prototype").numel())
                done, isolated = self._learn(state, rows[: done + max(1, at_once)], done, record)
                if len(isolated):
                    deleted[done - 1] = torch.from_numpy(isolated)
                    state.delete_nodes(deleted[done - 1])
        return map_update(record, deleted)

    def step(self, state: MapState, percept: NDArray[np.float32]) -> Step | None:
        """Learn one percept `[D]`, in place; return None if it is not finite or too large."""
        with self._learning:
            _, scale = self._arrays_to_read(state)
            if not kernels.scale_one(percept, scale, _LARGEST, self._percept):
                return None
            done, isolated, one = 0, _NO_NODES, self._one
            while done == 0:
                done, isolated = self._learn(state, self._percept, 0, one)
            if len(isolated):
                state.delete_nodes(torch.from_numpy(isolated))
            events = one.events.item()
            ignored = events & kernels.IGNORED != 0
            return Step(
                one.winner.item(), one.runner_up.item(), one.activation.item(),
                events & kernels.NOVEL != 0, not ignored, events & kernels.INSERTED != 0, ignored,
                events & kernels.DISHABITUATED != 0, len(isolated),
            )  # fmt: skip

    def _learn(
        self, state: MapState, percepts: NDArray[np.float32], start: int, record: Record
    ) -> tuple[int, NDArray[np.int64]]:
        """Call the kernel once; return the index of the next sample, and the nodes to delete."""
        columns, isolated = self._arrays_to_learn(state), self._isolated
        before = self._counts.tolist()
        learn: Any = kernels.learn  # a type checker counts the columns as one argument
        try:
            done, status, nodes, edges = learn(
                percepts, start, *columns, self._lists, self._degree, self._listed_ends,
                self._counts, self._rules, *record, isolated,
            )  # fmt: skip
        except BaseException:  # a Ctrl-C on the way back: new rows stay beyond the buffers' ends
            self._buffers = ()
            raise
        if nodes != before[NODES] or edges != before[EDGES]:
            state.nodes.set_length(nodes)
            state.edges.set_length(edges)
            self._note_buffers(state)
        if status == INVALID:
            raise ValueError(
                f"expected percepts of {len(columns[0])} dimensions, and edges between two of "
                f"{nodes} nodes each, got others"
            )
        if status == ISOLATED:
            return done, np.sort(isolated[: isolated[-1]])
        if status == FULL and done == start and [nodes, edges] == before[:LISTED]:
            # The columns had capacity, so a list of edges is full.
            self._make_lists(len(self._lists), 2 * self._lists.shape[1])
        return done, _NO_NODES

    def _arrays_to_learn(self, state: MapState) -> tuple[NDArray[Any], ...]:
        """Return the map's columns, with capacity for a node and two edges more, and its time.

        They are looked up again when a buffer was replaced or moved, or is full.

        Raises:
            ValueError: buffers of other shapes or types, or of unequal length.
        """
        columns, counts = self._columns, self._counts
        if self._are_same_buffers(state):
            nodes, edges, _ = counts.tolist()
            if nodes < columns[0].shape[1] and edges + 2 <= len(columns[4]):
                return columns
        # Buffers made inside a caller's inference mode could not be updated later.
        with torch.inference_mode(False):
            of_nodes, of_edges = state.nodes.arrays(1), state.edges.arrays(2)
        time = _array_of(state.buffers["time"]).reshape(1)
        if time.dtype != np.int64:
            raise ValueError(f"expected time as torch.int64, got {time.dtype}")
        self._columns = columns = (*of_nodes.values(), *of_edges.values(), time)
        self._note_buffers(state)
        counts[:LISTED] = len(state.nodes), len(state.edges)
        capacity, edge_capacity = of_nodes["prototype"].shape[-1], len(of_edges["age"])
        if len(self._lists) != capacity:
            self._make_lists(capacity, self._lists.shape[1])
            self._isolated = np.zeros(capacity + 1, np.int64)
        if len(self._listed_ends) != edge_capacity:
            self._listed_ends = np.zeros((edge_capacity, 2), np.int64)
            counts[LISTED] = NOT_LISTED
        return columns

    def _make_lists(self, nodes: int, longest: int) -> None:
        """Make empty lists, for so many nodes and so many edges of each."""
        self._lists = np.zeros((nodes, longest), np.int64)
        self._degree = np.zeros(nodes, np.int64)
        self._counts[LISTED] = NOT_LISTED

    def _note_buffers(self, state: MapState) -> None:
        self._buffers = _buffers_of(state)
        self._addresses = tuple(map(Tensor.data_ptr, self._buffers))

    def _are_same_buffers(self, state: MapState) -> bool:
        """Return whether these buffers were looked up last, and have not moved since."""
        buffers = _buffers_of(state)
        same = all(map(operator.is_, buffers, self._buffers))
        return same and self._addresses == tuple(map(Tensor.data_ptr, buffers))

    def _arrays_to_read(self, state: MapState) -> tuple[tuple[NDArray[Any], int], NDArray[Any]]:
        """Return prototypes and scale, looked up again when they were replaced or moved."""
        read, scale = self._last_read, state.buffers["scale"]
        prototype: Any = state.nodes._buffers["prototype"]
        same = read[0] is prototype and read[1] is scale
        if same and read[2] == prototype.data_ptr() and read[3] == scale.data_ptr():
            return read[4], read[5]
        if prototype.dim() != 2 or scale.dim() != 1 or scale.dtype != torch.float32:
            got = f"{describe(prototype)} and {describe(scale)}"
            raise ValueError(f"expected prototypes [nodes, D] and a float32 scale [D], got {got}")
        nodes, factors = state.nodes.transposed("prototype"), _array_of(scale)
        if nodes[0].ctypes.data == prototype.data_ptr() and scale.is_contiguous():  # no copies
            addresses = prototype.data_ptr(), scale.data_ptr()
            self._last_read = prototype, scale, *addresses, nodes, factors
        return nodes, factors


def _buffers_of(state: MapState) -> tuple[Any, ...]:
    return *state.nodes._buffers.values(), *state.edges._buffers.values(), state.buffers["time"]


def _array_of(tensor: Tensor) -> NDArray[Any]:
    """Return an array of the same memory if that is contiguous, else of a copy."""
    return check_storage("tensor", tensor).detach().contiguous().numpy()
