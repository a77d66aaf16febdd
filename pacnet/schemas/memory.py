"""Episodic memory: schemas, and the episodes that visited them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from pacnet.core.growable_rows import Column, GrowableRows, check_storage, copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.core.validation import (
    MAX_SAMPLES,
    check_fields,
    check_index,
    check_indices,
    is_integer,
    is_number,
)
from pacnet.schemas.interface import NO_EPISODE
from pacnet.schemas.sequences import INTEGER, Sequences
from pacnet.schemas.state_checks import episodes_hold, references_hold, sequences_hold


@dataclass(frozen=True)
class EpisodicMemoryConfig:
    """How schemas are distinguished and consolidated.

    Attributes:
        target_dimensions: length A of a target.
        percept_dimensions: length D of a cue.
        schemas_per_node: maximum number of different schemas of a node. If all of them have been
            seen more than once, the node keeps no further one.
        same_schema_similarity: similarity exp(−distance), in (0, 1), from which two schemas of a
            node count as the same one, seen twice. The distance is the larger of those between
            their cues and between their continuations. Twice the length of a percept's noise, in
            normalized units, is a good distance.
        lookahead_samples: number of samples after a schema's last at which its continuation is
            taken: half a second at the data's rate. A node that wins again within as many
            continues its schema.
        max_quality_drop: share, in [0, 1), by which an episode's quality may be below that of the
            stored sequences and still renew them; see `pacnet.schemas.consolidation`.
    """

    target_dimensions: int
    percept_dimensions: int
    schemas_per_node: int = 8
    same_schema_similarity: float = 0.82
    lookahead_samples: int = 25
    max_quality_drop: float = 0.25

    def __post_init__(self) -> None:
        """Validate the fields."""
        integers = ("target_dimensions", "percept_dimensions", "schemas_per_node")
        checks = {name: (is_integer(getattr(self, name), 1), "≥ 1") for name in integers}
        similarity, drop = self.same_schema_similarity, self.max_quality_drop
        after = self.lookahead_samples
        is_similarity = is_number(similarity) and 0 < similarity < 1
        is_count = is_integer(after, 1) and after <= MAX_SAMPLES
        checks["same_schema_similarity"] = (is_similarity, "in (0, 1)")
        checks["lookahead_samples"] = (is_count, f"from 1 to {MAX_SAMPLES} samples")
        checks["max_quality_drop"] = (is_number(drop) and 0 <= drop < 1, "in [0, 1)")
        check_fields(self, checks)


class EpisodicMemory(Sequences):
    """A store of episodes: schemas, and the visits of episodes to them.

    A visit is a stretch of an episode at one habituated node. A schema that several episodes visit
    is stored once, with the sequence of one of them.

    Args:
        config: see `EpisodicMemoryConfig`.

    Attributes:
        behaviours: names of the demonstrated behaviours, in order of first use.
    """

    config: EpisodicMemoryConfig
    nodes: Tensor

    def __init__(self, config: EpisodicMemoryConfig) -> None:
        cue = Column((config.percept_dimensions,), torch.float32)
        number = Column((), torch.float32)
        super().__init__(
            config.target_dimensions,
            config.percept_dimensions,
            of_sequence={
                "node": INTEGER,
                "shown_in": INTEGER,  # row of the episode that its sequence is from
                "support": INTEGER,  # number of visits, `OPEN` until its episode is over
                "typical_length": number,  # geometric mean of the visits' lengths
                "fit": number,  # mean activation of the node by its cues
                "continuation": cue,  # the percept `lookahead_samples` after its end
            },
            of_row={"frame": INTEGER},  # sample of its episode
        )
        self.config = config
        self.episodes = GrowableRows(
            {"number": INTEGER, "behaviour": INTEGER, "samples": INTEGER, "last_cue": cue}
        )
        self.visits = GrowableRows(
            {"episode": INTEGER, "schema": INTEGER, "first": INTEGER, "last": INTEGER}
        )
        self.behaviours: list[str] = []
        self.register_buffer("nodes", torch.tensor(0))
        copy_on_state_dict(self)
        check_on_load(self)

    def __len__(self) -> int:
        """Return the number of nodes."""
        return int(check_storage("nodes", self.nodes))

    def extra_repr(self) -> str:
        """Return how much is stored, for `print`."""
        stored = f"schemas={len(self.blocks)}, episodes={len(self.episodes)}"
        return f"{super().extra_repr()}, {stored}, behaviours={self.behaviours}"

    def get_extra_state(self) -> Tensor:
        """Return the behaviours' names, as the bytes of a JSON list, uint8."""
        names = list(json.dumps(self.behaviours).encode())
        return torch.tensor(names, dtype=torch.uint8, device=self.nodes.device)

    def set_extra_state(self, state: Tensor) -> None:
        """Take the behaviours' names from `get_extra_state`.

        Raises:
            ValueError: it is not a list of different names.
        """
        self.behaviours = _names(state)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are a valid state."""
        check_structure(self, tensors)
        check_conditions(
            {"a number of nodes ≥ 0": tensors["nodes"] >= 0, **sequences_hold(tensors)}
        )
        check_conditions(references_hold(len(_names(tensors["_extra_state"])), tensors))
        check_conditions(episodes_hold(tensors))

    @staticmethod
    def extent(tensors: Mapping[str, Tensor]) -> tuple[int, int]:
        """See `Schemas.extent`."""
        episodes = tensors["episodes.number"].tolist()
        return int(tensors["nodes"]), max(episodes, default=NO_EPISODE)

    def check(self) -> None:
        """Check the buffers, which a user may have changed.

        Raises:
            ValueError: as `Sequences.check`, or rows that refer to rows that do not exist.
        """
        super().check()
        check_storage("nodes", self.nodes)
        if self.nodes.shape != () or self.nodes.dtype != torch.int64:
            raise ValueError(f"expected a number of nodes, got {self.nodes}")
        check_conditions(references_hold(len(self.behaviours), dict(self.named_buffers())))

    def schemas_of(self, node: int) -> Tensor:
        """Return the ids of the node's schemas, int64 `[K]`.

        Raises:
            ValueError: no such node.
        """
        node = check_index("a node", node, len(self))
        return (self.blocks.live("node") == node).nonzero().flatten()

    def frames(self, schema: int) -> Tensor:
        """Return the samples of their episode at which its targets were shown, int64 `[L]`."""
        return self.rows_in("frame", schema)

    def add_node(self) -> int:
        """Add a node without schemas and return its number."""
        self.nodes += 1
        return len(self) - 1

    def delete(self, nodes: Tensor) -> None:
        """See `Schemas.delete`."""
        check_indices("nodes", nodes, len(self))
        self.check()
        of_node = self.blocks.live("node")
        self.drop(torch.isin(of_node, nodes).nonzero().flatten())
        of_node = self.blocks.live("node")
        of_node -= torch.searchsorted(nodes, of_node)
        self.nodes -= len(nodes)

    def drop(self, schemas: Tensor) -> None:
        """Delete schemas, int64 `[K]` ascending, and the visits to them.

        Raises:
            ValueError: not ascending, or no such schemas.
        """
        check_indices("schemas", schemas, len(self.blocks))
        visited = self.visits.live("schema")
        self.visits.delete(torch.isin(visited, schemas).nonzero().flatten())
        self.blocks.delete(schemas)
        visited = self.visits.live("schema")
        visited -= torch.searchsorted(schemas, visited)


def _names(state: Tensor) -> list[str]:
    try:
        names = json.loads(bytes(state.tolist()))
    except (RecursionError, ValueError) as error:
        raise ValueError(f"expected names of behaviours as JSON, got {error}") from error
    strings = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not strings or len(set(names)) < len(names):
        raise ValueError(f"expected a list of different names of behaviours, got {names}")
    return names
