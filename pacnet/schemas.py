"""Motor schemas: for each node of the map a growing sequence of targets, written by three rules.

Source: Maistros, Marom & Hayes (2001), section "The Integrated System". Each target is kept with
its cue, the percept it was shown with, so that recall can keep pace with what it sees.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention import NOBODY
from pacnet.engine import Engine, check_engine, runs_compiled
from pacnet.sequences import (
    NUMBER,
    RecalledRow,
    RecalledTarget,
    RecalledTargets,
    Samples,
    Sequences,
)
from pacnet.validation import check_fields, check_rows, is_integer

if TYPE_CHECKING:
    from pacnet.compiled_schemas import CompiledSchemas

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
        engine: as of `HabituatingSOFM`; what is compiled is recall by cue.

    Raises:
        ValueError: no such engine. With `compiled`, recall raises it where it cannot run.
    """

    def __init__(self, config: MotorSchemasConfig, engine: Engine = "auto") -> None:
        super().__init__(config.target_dimensions, config.percept_dimensions, {"episode": NUMBER})
        check_engine(engine)
        self.config = config
        self.engine: Engine = engine
        self._compiled: CompiledSchemas | None = None
        self.register_load_state_dict_post_hook(_start_recall_afresh)
        self.reset()

    def __len__(self) -> int:
        """The number of nodes."""
        return len(self.blocks)

    def reset(self) -> None:
        """Starts a recall episode: every position is forgotten."""
        self._positions: dict[int, int] = {}  # of nodes that have won in this episode

    def add_node(self) -> int:
        """Adds a node with an empty sequence and returns its number."""
        return self.blocks.append({"start": 0, "length": 0, "room": 0, "episode": NO_EPISODE})

    def delete(self, nodes: Tensor) -> None:
        """Deletes nodes, int64 `[K]`, with their targets; the later ones move down.

        Their numbers change, so a recall episode in progress starts afresh.
        """
        self.blocks.delete(nodes)
        self.reset()

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
            ValueError: no such node, or a target or cue of the wrong shape, dtype or device, or
                not finite; nothing has been written then.
        """
        self._check_node(node)
        check_rows("targets", target[None], self.config.target_dimensions, self.pool.live("target"))
        check_rows("cues", cue[None], self.config.percept_dimensions, self.pool.live("cue"))
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

    @torch.no_grad()
    def recall(self, node: int, percept: Tensor) -> RecalledTarget | None:
        """The current target of the winner, and its position in the sequence.

        With `recall_by="cue"` the position is that of the cue nearest to the percept, of exactly
        equal ones the first, and the target the mean over the `nearest_cues` nearest, or over all
        if there are fewer. With `recall_by="order"` it starts at the first target and advances
        by one while the node keeps winning; a node re-entered within the episode goes on where it
        was, and off the end the last target stays. `reset` starts a new episode.

        Args:
            node: the winner, or `NOBODY`.
            percept: `[D]`, scaled.

        Returns:
            The target, or None if the node has none.

        Raises:
            ValueError: no such node.
        """
        if node == NOBODY:
            return None
        self._check_node(node)
        targets = self.targets(node)
        if len(targets) == 0:
            return None
        if self.config.recall_by == "cue":
            return self._recall_by_cue(node, percept, targets)
        position = min(self._positions.get(node, -1) + 1, len(targets) - 1)
        self._positions[node] = position
        return RecalledTarget(targets[position].clone(), position, node)

    @torch.no_grad()
    def recall_samples(self, nodes: Tensor, percepts: Tensor) -> RecalledTargets:
        """`recall` for winners, or `NOBODY`, int64 `[T]`, and scaled percepts `[T, D]`."""
        compiled = self._compiled_recall()
        if compiled is None:
            return super().recall_samples(nodes, percepts)
        if int(nodes.max()) != NOBODY:
            self._check_node(int(nodes.max()))
        target, position = compiled.recall(nodes, percepts)
        return RecalledTargets(target, position, nodes.where(position != NOBODY, NOBODY))

    def recall_row(self, node: int, percept: NDArray[np.float32]) -> RecalledRow | None:
        """`recall` for a scaled percept `[D]` that is no tensor."""
        compiled = self._compiled_recall()
        if compiled is None:
            return super().recall_row(node, percept)
        if node == NOBODY:
            return None
        self._check_node(node)
        recalled = compiled.recall_one(node, percept)
        return None if recalled is None else RecalledRow(*recalled, node)

    def _compiled_recall(self) -> CompiledSchemas | None:
        """The compiled engine, or None where the eager one runs."""
        compiled = self._compiled
        if compiled is not None and compiled.is_current(self.config):
            return compiled
        if not runs_compiled(self.engine, self.pool.get_buffer("target")):
            return None
        if self.config.recall_by == "order":
            return None
        from pacnet.compiled_schemas import CompiledSchemas

        self._compiled = CompiledSchemas(self)
        return self._compiled

    def _recall_by_cue(self, node: int, percept: Tensor, targets: Tensor) -> RecalledTarget:
        distance = (self.cues(node) - percept).square().sum(dim=1)  # [L], squared
        nearest = distance.argsort(stable=True)[: self.config.nearest_cues]
        return RecalledTarget(targets[nearest].mean(dim=0), int(nearest[0]), node)

    def _check_node(self, node: int) -> None:
        if not 0 <= node < len(self):
            raise ValueError(f"expected a node from 0 to {len(self) - 1}, got {node}")


def _start_recall_afresh(schemas: nn.Module, _incompatible_keys: object) -> None:
    """Positions in the sequences that were here before mean nothing in the loaded ones."""
    assert isinstance(schemas, MotorSchemas)
    schemas.reset()
