"""The compiled engine of recall by cue: tells the kernels where the motor schemas' buffers lie.

Imported only where it runs, for it brings numba.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet import schemas_kernels as kernels
from pacnet.engine import Memory

if TYPE_CHECKING:
    from pacnet.schemas import MotorSchemas


class CompiledSchemas:
    """Recalls from motor schemas in compiled kernels, on their own buffers.

    Args:
        schemas: float32, on the CPU, recalled by cue.
    """

    def __init__(self, schemas: MotorSchemas) -> None:
        self._config = config = schemas.config
        # Where modules keep their buffers: to look one up as an attribute takes a microsecond.
        self._buffers: Any = schemas.pool._buffers, schemas.blocks._buffers
        sizes = schemas.pool.capacity, config.target_dimensions, config.percept_dimensions
        self._node, self._position = np.empty((2, 1), np.int64)
        self._memory = Memory()
        self._memory.keep(self._tensors(), sizes)

    @property
    def is_current(self) -> bool:
        """Whether the buffers still lie where they did."""
        return self._memory.holds(tuple([tensor.data_ptr() for tensor in self._tensors()]))

    def recall_one(
        self, node: int, percept: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], int] | None:
        """The target `[A]` for one scaled percept `[D]`, and its position; None without one."""
        self._node[0] = node
        target = np.empty((1, self._config.target_dimensions), np.float32)
        nearest_cues, table = self._config.nearest_cues, self._memory.table
        kernels.recall(table, self._node, percept[None], nearest_cues, target, self._position)
        position = int(self._position[0])
        return None if position < 0 else (target[0], position)

    def recall(self, nodes: Tensor, percepts: Tensor) -> tuple[Tensor, Tensor]:
        """Targets `[T, A]`, NaN where there is none, and positions `[T]`, −1 there.

        Args:
            nodes: the winners, or `NOBODY`, int64 `[T]`.
            percepts: `[T, D]`, scaled.
        """
        targets = np.full((len(nodes), self._config.target_dimensions), np.nan, np.float32)
        positions = np.empty(len(nodes), np.int64)
        rows = np.ascontiguousarray(percepts.detach().numpy())
        numbers = np.ascontiguousarray(nodes.numpy())
        nearest_cues, table = self._config.nearest_cues, self._memory.table
        kernels.recall(table, numbers, rows, nearest_cues, targets, positions)
        return torch.from_numpy(targets), torch.from_numpy(positions)

    def _tensors(self) -> tuple[Tensor, ...]:
        pool, blocks = self._buffers
        return pool["target"], pool["cue"], blocks["start"], blocks["length"]
