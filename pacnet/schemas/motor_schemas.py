"""Motor schemas: one growing sequence of targets per node of the map, written by three rules.

Source: Maistros, Marom & Hayes (2001), section "The Integrated System". Each target is kept with
its cue, the percept it was shown with, so that recall follows the pace of what is perceived.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.records import NO_NODE
from pacnet.core.drafts import BufferVersions, snapshot_of
from pacnet.core.growable_rows import as_array
from pacnet.core.integrity import check_conditions, check_on_load, check_structure, part_of
from pacnet.core.validation import (
    as_batch,
    check_fields,
    check_index,
    check_indices,
    is_integer,
)
from pacnet.schemas.forgetting import (
    FORGOTTEN,
    HABITUATED_AT,
    count_replaced,
    forgetting_holds,
    load_without,
)
from pacnet.schemas.interface import NO_EPISODE, Samples, Schemas, Target
from pacnet.schemas.merging import COUNTS, add_within_budget, budget_holds, check_counted
from pacnet.schemas.sequences import INTEGER
from pacnet.schemas.state_checks import sequences_hold


@dataclass(frozen=True)
class MotorSchemasConfig:
    """How targets are kept and recalled.

    Attributes:
        target_dimensions: length A of a target.
        percept_dimensions: length D of a cue.
        recall_by: how the current target is found in the winner's sequence. `cue`: the target whose
            cue is nearest to the percept, so that a slower, faster or interrupted demonstration is
            followed at its own pace. `order`: the next target at each sample, as in the paper.
        nearest_cues: with `cue`, the number of nearest cues whose targets are averaged. One
            reproduces the demonstration; more average out random differences between targets of
            similar percepts.
        budget: number of targets that are kept, at most, of all nodes together; see
            `pacnet.schemas.merging`. None for all.
        type: which kind of motor schemas it is, in a checkpoint's `config.json`.
    """

    target_dimensions: int
    percept_dimensions: int
    recall_by: Literal["cue", "order"] = "cue"
    nearest_cues: int = 1
    budget: int | None = None
    type: ClassVar[str] = "motor_schemas"

    def __post_init__(self) -> None:
        """Validate the fields."""
        integers = ("target_dimensions", "percept_dimensions", "nearest_cues")
        checks = {name: (is_integer(getattr(self, name), 1), "≥ 1") for name in integers}
        checks["budget"] = (self.budget is None or is_integer(self.budget, 1), "≥ 1, or None")
        checks["recall_by"] = (self.recall_by in ("cue", "order"), "'cue' or 'order'")
        check_fields(self, checks)


class MotorSchemas(Schemas):
    """One growable sequence of targets per node, overwritten by each new episode.

    Within an episode, targets of a node that was forgotten are replaced one by one by new ones; see
    `pacnet.schemas.forgetting`.

    The id of a sequence is the number of its node.

    Args:
        config: see `MotorSchemasConfig`.
    """

    def __init__(self, config: MotorSchemasConfig) -> None:
        of_sequence = {"episode": INTEGER, HABITUATED_AT: INTEGER, FORGOTTEN: INTEGER}
        of_row = None if config.budget is None else COUNTS
        super().__init__(config.target_dimensions, config.percept_dimensions, of_sequence, of_row)
        self.config = config
        self.behaviours = []
        self._cache: tuple[BufferVersions, tuple[NDArray[Any], ...], Any] | None = None
        self._offsets: dict[int, int] = {}  # of nodes that have won in this recall episode
        self.register_load_state_dict_post_hook(_restart_recall)
        load_without(self)
        check_on_load(self)

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.blocks)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are a valid state."""
        check_counted(tensors, self.config.budget)
        check_structure(self, tensors)
        check_conditions(sequences_hold(tensors))
        check_conditions({"episodes ≥ −1": (tensors["blocks.episode"] >= NO_EPISODE).all()})
        check_conditions(forgetting_holds(part_of(tensors, "blocks.")))
        if self.config.budget is not None:
            check_conditions(budget_holds(tensors, self.config.budget))

    @staticmethod
    def extent(tensors: Mapping[str, Tensor]) -> tuple[int, int]:
        """See `Schemas.extent`."""
        episodes = tensors["blocks.episode"].tolist()
        return len(episodes), max(episodes, default=NO_EPISODE)

    def reset(self) -> None:
        """Start a new recall episode: forget all offsets."""
        self._offsets.clear()

    def add_node(self) -> int:
        """Add a node with an empty sequence and return its number."""
        never = {"episode": NO_EPISODE, HABITUATED_AT: NO_NODE, FORGOTTEN: 0}
        return self.blocks.append({"start": 0, "length": 0, "capacity": 0, **never})

    def delete(self, nodes: Tensor) -> None:
        """See `Schemas.delete`; a recall episode in progress starts again."""
        check_indices("nodes", nodes, len(self))
        self.blocks.check()
        self.blocks.delete(nodes)
        self._offsets = {}

    def begin_episode(self, number: int, behaviour: str) -> None:
        """Do nothing: `add_samples` is given the episode's number."""

    @torch.no_grad()
    def write(
        self,
        node: int,
        target: Tensor,
        cue: Tensor,
        episode: int,
        *,
        habituated: bool,
        habituated_at: int = NO_NODE,
    ) -> None:
        """Apply the three rules of the paper to one sample at which the node won.

        Args:
            node: the winner.
            target: the current target, `[A]`.
            cue: the normalized percept, `[D]`.
            episode: number of the learning episode.
            habituated: whether the winner is fully habituated.
            habituated_at: sample since when it is; another one than before says that the node was
                forgotten: new targets replace the old. `NO_NODE` where that is not known.

        Raises:
            ValueError: no such node, episode or sample, or a target or cue of the wrong shape,
                dtype or device, not finite or too large; nothing has been written then.
        """
        node = check_index("a node", node, len(self))
        episode = check_index("an episode", episode, 2**63)
        self.check_pair(as_batch(target), as_batch(cue))
        if self.training and habituated:
            since = check_index("a sample", habituated_at, 2**63, optional=True)
            nodes, since, whether = self.lengths.new_tensor([[node], [since], [1]])
            activation = cue.new_ones(1)  # not used
            samples = Samples(nodes, activation, whether.bool(), target[None], cue[None], since)
            self.add_samples(samples, episode)

    @torch.no_grad()
    def add_samples(self, samples: Samples, episode: int) -> None:
        """Do what `write` does, for checked samples; in eval mode, nothing."""
        # Rule 1: the winner is not fully habituated. Its schema stays as it is.
        written = (samples.habituated & self.training).nonzero().flatten()
        if len(written) == 0:
            return
        if self.config.budget is None:
            self._add(samples, written[samples.node[written].argsort(stable=True)], episode)
        else:
            samples = Samples(*(column[written] for column in samples))
            add_within_budget(self, samples, episode, self.config.budget)

    def _add(self, samples: Samples, written: Tensor, episode: int) -> None:
        """Apply rules 2 and 3 to samples of habituated nodes, equal nodes together."""
        node = samples.node[written]
        nodes, counts = node.unique_consecutive(return_counts=True)
        # Rule 3: a new learning episode. The sequence is cleared and starts with these targets.
        cleared = nodes[self.blocks.live("episode")[nodes] != episode]
        for column, value in (("length", 0), (FORGOTTEN, 0), ("episode", episode)):
            self.blocks.live(column)[cleared] = value
        # Rule 2: the same learning episode. The targets are appended, or replace forgotten ones.
        replaced = count_replaced(self.blocks, node, samples.habituated_at[written])
        rows = {"target": samples.target[written], "cue": samples.cue[written]}
        self.append_rows(nodes, counts, rows)
        if replaced:
            self.drop_first(*map(counts.new_tensor, (list(replaced), list(replaced.values()))))

    def recall_one(self, node: int, percept: NDArray[np.floating]) -> Target | None:
        """Return the current target of a winner, and its offset in the sequence.

        With `recall_by="cue"` it is the target of the nearest cue (ties go to the lowest index), or
        the mean over the `nearest_cues` nearest, or over all if there are fewer. With
        `recall_by="order"` the offset starts at 0 and advances by one at each win in the episode;
        at the end of the sequence it stays.
        """
        if self.config.recall_by == "order":
            return self._recall_by_order(node)
        arguments = self._kernel_arguments()
        stored = arguments[0][3]
        targets, offsets = np.empty((1, stored.shape[1]), stored.dtype), np.empty(1, np.int64)
        self._recall_by_cue(arguments, np.array([node]), percept[None], targets, offsets)
        offset = offsets.item()
        return None if offset < 0 else Target(targets[0], offset, node)

    def recall_all(self, nodes: NDArray[np.int64], percepts: NDArray[np.floating]) -> Target:
        """See `Schemas.recall_all`."""
        if self.config.recall_by == "order":
            return super().recall_all(nodes, percepts)
        arguments = self._kernel_arguments()
        stored = arguments[0][3]
        targets = np.full((len(nodes), stored.shape[1]), np.nan, stored.dtype)
        offsets = np.full(len(nodes), NO_NODE)
        self._recall_by_cue(arguments, nodes, percepts, targets, offsets)
        return Target(targets, offsets, np.where(offsets < 0, NO_NODE, nodes))

    def _recall_by_cue(
        self,
        arguments: tuple[tuple[NDArray[Any], ...], Any],
        nodes: NDArray[np.int64],
        percepts: NDArray[np.floating],
        targets: NDArray[np.floating],
        offsets: NDArray[np.int64],
    ) -> None:
        """Write targets `[T, A]` and offsets `[T]`, −1 where there is no target."""
        arrays, kernel = arguments
        rows = arrays[2].shape[1]
        nearest = min(self.config.nearest_cues, rows)
        if not kernel(nodes, percepts, *arrays, nearest, targets, offsets):
            raise ValueError(f"expected sequences within the {rows} rows of the pool")

    def for_recall(self) -> MotorSchemas:
        """See `Schemas.for_recall`."""
        schemas = snapshot_of(self)
        if schemas.config.recall_by == "cue":
            # Its tensors do not change, so the cache is always valid.
            schemas._cache = BufferVersions(), *schemas._kernel_arguments()
        return schemas

    def _recall_by_order(self, node: int) -> Target | None:
        targets = [] if node == NO_NODE else self.targets(node)
        if len(targets) == 0:
            return None
        offset = min(self._offsets.get(node, -1) + 1, len(targets) - 1)
        self._offsets[node] = offset
        return Target(as_array(targets[offset].clone()), offset, node)

    def _kernel_arguments(self) -> tuple[tuple[NDArray[Any], ...], Any]:
        """Return starts, lengths, cues and targets as arrays, and the kernel."""
        if self._cache is None or not self._cache[0].unchanged():
            from pacnet.schemas import kernels  # imports numba

            self.blocks.check()
            own = (self.blocks.live(name).numpy(force=True) for name in ("start", "length"))
            arrays = *own, np.ascontiguousarray(self.arrays("cue").T), self.arrays("target")
            self._cache = BufferVersions(self.pool, self.blocks), arrays, kernels.recall
        return self._cache[1], self._cache[2]

    def __getstate__(self) -> dict[str, Any]:
        """Leave the cache out of copies, which have other tensors."""
        return {**self.__dict__, "_cache": None}


def _restart_recall(schemas: nn.Module, _incompatible_keys: object) -> None:
    """Forget the offsets, which are of the sequences before a load."""
    assert isinstance(schemas, MotorSchemas)
    schemas.reset()
