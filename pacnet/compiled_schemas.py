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
from pacnet.engine import Memory, check_buffers

if TYPE_CHECKING:
    from pacnet.schemas import MotorSchemas, MotorSchemasConfig


class CompiledSchemas:
    """Recalls from motor schemas in compiled kernels, on their own buffers.

    Args:
        schemas: float32, on the CPU, recalled by cue.

    Raises:
        ValueError: buffers that kernels cannot take, or that contradict one another.
    """

    def __init__(self, schemas: MotorSchemas) -> None:
        self._config = config = schemas.config
        # Where modules keep their buffers: to look one up as an attribute takes a microsecond.
        self._buffers: Any = schemas.pool._buffers, schemas.blocks._buffers
        sizes = schemas.pool.capacity, config.target_dimensions, config.percept_dimensions
        self._node, self._position = np.empty((2, 1), np.int64)
        self._memory = Memory()
        _check_blocks(schemas)
        buffers = {
            "target": (schemas.pool.get_buffer("target"), torch.float32),
            "cue": (schemas.pool.get_buffer("cue"), torch.float32),
            "start": (schemas.blocks.get_buffer("start"), torch.int64),
            "length": (schemas.blocks.get_buffer("length"), torch.int64),
        }
        self._memory.keep(check_buffers(buffers), sizes)

    def is_current(self, config: MotorSchemasConfig) -> bool:
        """Whether this is still the config, and the buffers still lie where they did."""
        pool, blocks = self._buffers
        return config is self._config and self._memory.holds(
            (
                pool["target"].data_ptr(), pool["cue"].data_ptr(),
                blocks["start"].data_ptr(), blocks["length"].data_ptr(),
            )
        )  # fmt: skip

    def recall_one(
        self, node: int, percept: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], int] | None:
        """The target `[A]` for one scaled percept `[D]`, and its position; None without one."""
        self._node[0] = node
        target = np.empty((1, self._config.target_dimensions), np.float32)
        nearest_cues, (table, _) = self._config.nearest_cues, self._memory.held
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
        nearest_cues, (table, _) = self._config.nearest_cues, self._memory.held
        kernels.recall(table, numbers, rows, nearest_cues, targets, positions)
        return torch.from_numpy(targets), torch.from_numpy(positions)


def _check_blocks(schemas: MotorSchemas) -> None:
    """Raises a ValueError unless every sequence lies within the pool."""
    start, length = schemas.blocks.live("start"), schemas.lengths
    within = (start >= 0) & (length >= 0) & (start + length <= len(schemas.pool))
    if not bool(within.all()):
        node = int((~within).nonzero()[0])
        raise ValueError(
            f"expected sequences within the {len(schemas.pool)} rows of the pool, "
            f"got {int(length[node])} from row {int(start[node])} on for node {node}"
        )
