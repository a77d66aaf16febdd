"""The compiled engine of the growing map: lends its buffers to the kernels and reads their log.

Imported only where it runs, for it brings numba.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from pacnet import sofm_kernels as kernels
from pacnet.attention import Attention, Lesson, Observation, Step
from pacnet.engine import Memory, check_buffers, check_row
from pacnet.sofm_config import LARGEST_PERCEPT, SOFMConfig
from pacnet.sofm_rules import rules_of
from pacnet.threads import share_rows

if TYPE_CHECKING:
    from pacnet.sofm import HabituatingSOFM

_WORK = 2**27  # multiplications between two chances for a Ctrl-C, some 20 ms
_LARGEST = np.float32(LARGEST_PERCEPT)


class CompiledSOFM:
    """Runs a map's learning and reading in compiled kernels, on the map's own buffers.

    Args:
        sofm: the map; float32, on the CPU.

    Attributes:
        scaled: the last percept of `step` in the map's own units, `[D]`.

    Raises:
        ValueError: buffers that kernels cannot take, or that contradict one another.
    """

    def __init__(self, sofm: HabituatingSOFM) -> None:
        self._sofm, self._config = sofm, (config := sofm.config)
        self._rules = rules_of(config)
        self._scratch = kernels.scratch(config.dimensions)
        self._address = self._scratch.ctypes.data
        self.scaled = self._scratch[: config.dimensions]
        # Where modules keep their buffers: to look one up as an attribute takes a microsecond.
        self._buffers: Any = sofm.nodes._buffers, sofm.edges._buffers, sofm._buffers
        self._memory = Memory()
        _check_edges(sofm)
        self._find()

    def is_current(self, config: SOFMConfig) -> bool:
        """Whether this is still the map's config, and its buffers still lie where they did."""
        nodes, edges, own = self._buffers
        return config is self._config and self._memory.holds(
            (
                nodes["prototype"].data_ptr(), nodes["habituation"].data_ptr(),
                nodes["habituated_at"].data_ptr(), edges["ends"].data_ptr(),
                edges["age"].data_ptr(), own["time"].data_ptr(), own["scale"].data_ptr(),
            )
        )  # fmt: skip

    def observe(self, percepts: Tensor) -> Lesson:
        """Learns scaled percepts `[T, D]`, in order of time."""
        samples = len(percepts)
        log = kernels.Log(
            winner=np.empty(samples, np.int64),
            runner_up=np.empty(samples, np.int64),
            activation=np.empty(samples, np.float32),
            events=np.empty(samples, np.uint8),
            deleted=np.empty(samples, np.int64),
            gone=np.empty(samples + len(self._sofm), np.int64),
        )
        rows = np.ascontiguousarray(percepts.detach().numpy())
        done = gone = 0
        while done < samples:
            self._make_room()
            at_once = _WORK // self._sofm.nodes.get_buffer("prototype").numel()
            stop = min(samples, done + max(1, at_once))
            table, _ = self._memory.held
            done, gone = kernels.observe(
                rows, table, self._address, self._rules, log, done, stop, gone
            )
        return _as_lesson(log, gone)

    def step(self, percept: object, *, learns: bool) -> Step:
        """Learns one percept `[D]`, not scaled yet, or only reads.

        Raises:
            ValueError: as `HabituatingSOFM.step`.
        """
        self.scaled[:] = check_row("percept", percept, len(self.scaled))
        status, fields = self._step(learns)
        if status == kernels.NO_ROOM:
            self._make_room()
            status, fields = self._step(learns)
        if status == kernels.INVALID:
            self._sofm.scaled(torch.from_numpy(self.scaled.copy())[None])  # says what is wrong
        assert status == kernels.DONE
        return Step._make(fields)

    def _step(self, learns: bool) -> tuple[int, tuple[Any, ...]]:
        table, _ = self._memory.held
        return kernels.step(table, self._address, self._rules, _LARGEST, learns)

    def read(self, percepts: Tensor) -> Attention:
        """Reads scaled percepts `[B, D]`, without gradient, in as many threads as torch uses."""
        count = len(percepts)
        rows = np.ascontiguousarray(percepts.detach().numpy())
        table, _tensors = self._memory.held  # both, though another thread may let the map grow
        winner, runner_up = np.empty((2, count), np.int64)
        activation, novelty = np.empty(count, np.float32), np.empty(count, np.bool_)
        answers = winner, runner_up, activation, novelty

        def read(start: int, stop: int) -> None:
            own = (answer[start:stop] for answer in answers)
            scratch = kernels.scratch(rows.shape[1])
            kernels.read(rows[start:stop], table, scratch.ctypes.data, self._rules, *own)

        share_rows(read, count, work=count * len(self._sofm) * rows.shape[1])
        return Attention(*map(torch.from_numpy, answers))

    def _make_room(self) -> None:
        """For one more node and the two edges that it may bring."""
        nodes, edges = self._sofm.nodes, self._sofm.edges
        if len(nodes) < nodes.capacity and len(edges) + 2 <= edges.capacity:
            return
        # Made inside a caller's inference mode they would be buffers nobody can update later.
        with torch.inference_mode(False):
            nodes.make_room(1)
            edges.make_room(2)
        self._find()

    def _find(self) -> None:
        """Tells the kernels where the map's buffers lie, in the order in which they expect it."""
        nodes, edges = self._sofm.nodes, self._sofm.edges
        of_nodes, of_edges, own = self._buffers
        buffers = {
            "prototype": (of_nodes["prototype"], torch.float32),
            "habituation": (of_nodes["habituation"], torch.float32),
            "habituated_at": (of_nodes["habituated_at"], torch.int64),
            "ends": (of_edges["ends"], torch.int64),
            "age": (of_edges["age"], torch.int64),
            "time": (own["time"], torch.int64),
            "scale": (own["scale"], torch.float32),
        }
        counts = nodes.count.ctypes.data, edges.count.ctypes.data
        sizes = nodes.capacity, edges.capacity, len(self.scaled)
        self._memory.keep(check_buffers(buffers), (*counts, *sizes))


def _check_edges(sofm: HabituatingSOFM) -> None:
    """Raises a ValueError if an edge ends at a node that there is not."""
    ends, nodes = sofm.edges.live("ends"), len(sofm)
    if len(ends) and not 0 <= int(ends.min()) <= int(ends.max()) < nodes:
        raise ValueError(
            f"expected edges between nodes 0 to {nodes - 1}, "
            f"got ends from {int(ends.min())} to {int(ends.max())}"
        )


def _as_lesson(log: kernels.Log, gone: int) -> Lesson:
    novelty, inserted, ignored, dishabituated, habituated = (
        torch.from_numpy((log.events & event) != 0)
        for event in (
            kernels.NOVEL, kernels.INSERTED, kernels.IGNORED,
            kernels.DISHABITUATED, kernels.HABITUATED,
        )
    )  # fmt: skip
    observation = Observation(
        winner=torch.from_numpy(log.winner),
        runner_up=torch.from_numpy(log.runner_up),
        activation=torch.from_numpy(log.activation),
        novelty=novelty,
        attended=~ignored,
        inserted=inserted,
        ignored=ignored,
        dishabituated=dishabituated,
        deleted=torch.from_numpy(log.deleted),
    )
    return Lesson(observation, habituated, torch.from_numpy(log.gone[:gone].copy()))
