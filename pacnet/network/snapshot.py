"""Snapshots of a network, for a thread that acts while another one learns."""

from __future__ import annotations

from typing import Any

from pacnet.attention.sofm import HabituatingSOFM
from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.competition.recognition import Recognizer
from pacnet.core.drafts import BufferVersions, snapshot_of
from pacnet.schemas.interface import Schemas
from pacnet.schemas.sequences import compact


def check_nodes(sofm: HabituatingSOFM, schemas: Schemas) -> None:
    """Raise a ValueError unless each node has motor schemas, with cues like its percepts."""
    width, cues = sofm.nodes.live("prototype").shape[1:], schemas.pool.live("cue").shape[1:]
    if width != cues:
        raise ValueError(f"expected cues as long as prototypes, {list(width)}, got {list(cues)}")
    if len(sofm) != len(schemas):
        raise ValueError(
            f"expected motor schemas for each node, got {len(schemas)} for {len(sofm)} nodes"
        )


class Snapshot:
    """A recall episode of a map and its motor schemas, as they are now.

    Args:
        sofm: of the network; the snapshot shares its tensors and keeps them.
        schemas: likewise; they are compacted.

    Raises:
        ValueError: buffers that contradict one another.
    """

    def __init__(self, sofm: HabituatingSOFM, schemas: Schemas) -> None:
        check_nodes(sofm, schemas)
        schemas.check()
        compact(schemas)
        self.sofm, self.schemas = snapshot_of(sofm), schemas.for_recall()
        self._recognizer: Recognizer | None = None
        self.track(sofm, schemas)

    def track(self, sofm: HabituatingSOFM, schemas: Schemas) -> None:
        """Make `is_of` compare with these modules, which have the same tensors."""
        # Of the map's tensors, those that recall reads.
        self._versions = BufferVersions(
            schemas, single=[(sofm.nodes, "prototype"), (sofm, "scale")]
        )
        self._configs = sofm.config, schemas.config

    def is_of(self, sofm: Any, schemas: Any) -> bool:
        """Return whether these have not changed since."""
        same = sofm.config is self._configs[0] and schemas.config is self._configs[1]
        return same and self._versions.unchanged()

    def recognizer(self) -> Recognizer:
        """Return the recognizer of this episode.

        Raises:
            ValueError: one schema per node, or nothing learned yet: nothing can be recognized.
        """
        if not isinstance(self.schemas, CompetingSchemas):
            raise ValueError(
                "expected CompetingSchemasConfig to recognise with, got one schema a node"
            )
        if self._recognizer is None:
            self._recognizer = self.schemas.recognizer()
        return self._recognizer

    def reset(self) -> None:
        """Start a new episode."""
        self.schemas.reset()
        self._recognizer = None
