"""Motor schemas: for each node of the map a growing sequence of targets, written by three rules.

Source: Maistros, Marom & Hayes (2001), section "The Integrated System". Each target is kept with
its cue, the percept it was shown with, so that recall can keep pace with what it sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.records import NO_NODE
from pacnet.core.drafts import Tensors
from pacnet.core.integrity import check_forms, check_holds, check_on_load
from pacnet.core.validation import (
    batch_of_one,
    check_fields,
    check_number,
    check_numbers,
    is_integer,
)
from pacnet.schemas.sequences import (
    NUMBER,
    RecalledRow,
    RecalledRows,
    Samples,
    Sequences,
    as_array,
)
from pacnet.schemas.state_checks import sequences_hold

NO_EPISODE = -1
"""The episode of a schema that was never written."""


@dataclass(frozen=True)
class MotorSchemasConfig:
    """How targets are kept and recalled.

    Attributes:
        target_dimensions: length A of a target.
        percept_dimensions: length D of a cue.
        recall_by: how the position in the winner's sequence is found. `cue`: the target whose cue
            is nearest to the percept, so that a slower, faster or interrupted demonstration is
            followed at its own pace. `order`: one target further at each sample, as in the paper.
        nearest_cues: by `cue`, over how many of the nearest cues the target is averaged. One
            reproduces what was shown; more smooth away what differed by chance where similar
            percepts went on differently.
    """

    target_dimensions: int
    percept_dimensions: int
    recall_by: Literal["cue", "order"] = "cue"
    nearest_cues: int = 1

    def __post_init__(self) -> None:
        """Refuses values that have no meaning."""
        check_fields(
            self,
            {
                "target_dimensions": (is_integer(self.target_dimensions, 1), "≥ 1"),
                "percept_dimensions": (is_integer(self.percept_dimensions, 1), "≥ 1"),
                "recall_by": (self.recall_by in ("cue", "order"), "'cue' or 'order'"),
                "nearest_cues": (is_integer(self.nearest_cues, 1), "≥ 1"),
            },
        )


class MotorSchemas(Sequences):
    """One growable sequence of targets per node, overwritten by each new episode.

    The number of a sequence is that of its node.

    Args:
        config: see `MotorSchemasConfig`.
    """

    def __init__(self, config: MotorSchemasConfig) -> None:
        super().__init__(config.target_dimensions, config.percept_dimensions, {"episode": NUMBER})
        self.config = config
        self._cache: tuple[Tensors, tuple[NDArray[Any], ...], Any] | None = None
        self._positions: dict[int, int] = {}  # of nodes that have won in this recall episode
        self.register_load_state_dict_post_hook(_start_recall_afresh)
        check_on_load(self)

    def __len__(self) -> int:
        """The number of nodes."""
        return len(self.blocks)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError unless these tensors, of a `state_dict`, are the state of schemas."""
        check_forms(self, tensors)
        check_holds(sequences_hold(tensors))
        check_holds({"episodes ≥ −1": (tensors["blocks.episode"] >= NO_EPISODE).all()})

    def reset(self) -> None:
        """Starts a recall episode: every position is forgotten."""
        self._positions.clear()

    def add_node(self) -> int:
        """Adds a node with an empty sequence and returns its number."""
        return self.blocks.append({"start": 0, "length": 0, "room": 0, "episode": NO_EPISODE})

    def delete(self, nodes: Tensor) -> None:
        """Deletes nodes, int64 `[K]` ascending, with their targets; the later ones move down.

        Their numbers change, so a recall episode in progress starts afresh.

        Raises:
            ValueError: not ascending, or no such nodes.
        """
        check_numbers("nodes", nodes, len(self))
        self.blocks.check()
        self.blocks.delete(nodes)
        self._positions = {}

    @torch.no_grad()
    def write(
        self, node: int, target: Tensor, cue: Tensor, episode: int, *, habituated: bool
    ) -> None:
        """The three rules of the paper, for one sample at which the node won.

        Args:
            node: the winner.
            target: the current target, `[A]`.
            cue: the percept, scaled, `[D]`.
            episode: number of the learning episode.
            habituated: whether the winner is fully habituated.

        Raises:
            ValueError: no such node or episode, or a target or cue of the wrong shape, dtype or
                device, not finite or too large; nothing has been written then.
        """
        node = check_number("a node", node, len(self))
        episode = check_number("an episode", episode, 2**63)
        self.check_pair(batch_of_one(target), batch_of_one(cue))
        self.check()
        if self.training and habituated:
            nodes, counts = self.lengths.new_tensor([[node], [1]])
            self._write(nodes, counts, target[None], cue[None], episode)

    @torch.no_grad()
    def write_samples(self, samples: Samples, episode: int) -> None:
        """`write` for samples that the map has taken in, checked; nothing in eval mode."""
        # Rule 1: not fully habituated, still settling. The schema is left as it is.
        written = (samples.habituated & self.training).nonzero().flatten()
        written = written[samples.node[written].argsort(stable=True)]
        nodes, counts = samples.node[written].unique_consecutive(return_counts=True)
        self._write(nodes, counts, samples.target[written], samples.cue[written], episode)

    def _write(
        self, nodes: Tensor, counts: Tensor, targets: Tensor, cues: Tensor, episode: int
    ) -> None:
        """Rules 2 and 3 at habituated nodes `[N]`, for as many rows of one episode as they have."""
        # Rule 3: a new learning episode. The sequence is cleared, and starts with these targets.
        cleared = nodes[self.blocks.live("episode")[nodes] != episode]
        self.blocks.live("length")[cleared] = 0
        self.blocks.live("episode")[cleared] = episode
        # Rule 2: the same learning episode. The targets are appended.
        self.append_each(nodes, counts, {"target": targets, "cue": cues})

    def recall_checked(self, node: int, percept: NDArray[np.floating]) -> RecalledRow | None:
        """The current target of a winner, and its position in the sequence.

        With `recall_by="cue"` the position is that of the cue nearest to the percept, of exactly
        equal ones the first, and the target the mean over the `nearest_cues` nearest, or over all
        if there are fewer. With `recall_by="order"` it starts at the first target and advances
        by one while the node keeps winning; a node re-entered within the episode goes on where it
        was, and off the end the last target stays. `reset` starts a new episode.
        """
        if self.config.recall_by == "order":
            return self._recall_by_order(node)
        arrays, kernel = self._looked_up()
        target, position = np.empty((1, arrays[3].shape[1]), arrays[3].dtype), np.empty(1, np.int64)
        self._recall_by_cue(kernel, arrays, np.array([node]), percept[None], target, position)
        place = position.item()
        return None if place < 0 else RecalledRow(target[0], place, node)

    def recall_all(self, nodes: NDArray[np.int64], percepts: NDArray[np.floating]) -> RecalledRows:
        """See `Sequences.recall_all`."""
        if self.config.recall_by == "order":
            return super().recall_all(nodes, percepts)
        arrays, kernel = self._looked_up()
        targets = np.full((len(nodes), arrays[3].shape[1]), np.nan, arrays[3].dtype)
        positions = np.full(len(nodes), NO_NODE)
        self._recall_by_cue(kernel, arrays, nodes, percepts, targets, positions)
        return RecalledRows(targets, positions, np.where(positions < 0, NO_NODE, nodes))

    def hold_still(self) -> None:
        """What recall has looked up is not compared with the buffers again: they do not change."""
        if self.config.recall_by == "cue":
            self._cache = Tensors(), *self._looked_up()

    def _recall_by_order(self, node: int) -> RecalledRow | None:
        targets = [] if node == NO_NODE else self.targets(node)
        if len(targets) == 0:
            return None
        position = min(self._positions.get(node, -1) + 1, len(targets) - 1)
        self._positions[node] = position
        return RecalledRow(as_array(targets[position].clone()), position, node)

    def _recall_by_cue(
        self,
        kernel: Any,
        arrays: tuple[NDArray[Any], ...],
        nodes: NDArray[np.int64],
        percepts: NDArray[np.floating],
        targets: NDArray[np.floating],
        positions: NDArray[np.int64],
    ) -> None:
        """Writes targets `[T, A]` and positions `[T]`, −1 where there is no target."""
        rows = arrays[2].shape[1]
        number = min(self.config.nearest_cues, rows)
        if not kernel(nodes, percepts, *arrays, number, targets, positions):
            raise ValueError(f"expected sequences within the {rows} rows of the pool")

    def _looked_up(self) -> tuple[tuple[NDArray[Any], ...], Any]:
        """Where sequences start, how long they are, cues and targets; and the kernel."""
        if self._cache is None or not self._cache[0].are_current():
            from pacnet.competition import kernels as recall_kernels  # which brings numba

            self.blocks.check()
            own = (self.blocks.live(name).numpy(force=True) for name in ("start", "length"))
            arrays = *own, np.ascontiguousarray(self.arrays("cue").T), self.arrays("target")
            self._cache = Tensors(self.pool, self.blocks), arrays, recall_kernels.recall
        return self._cache[1], self._cache[2]

    def __getstate__(self) -> dict[str, Any]:
        """A copy looks up its own tensors."""
        return {**self.__dict__, "_cache": None}


def _start_recall_afresh(schemas: nn.Module, _incompatible_keys: object) -> None:
    """Positions in the sequences that were here before mean nothing in the loaded ones."""
    assert isinstance(schemas, MotorSchemas)
    schemas.reset()
