"""What a network acts on: all that it had learned at one moment.

A thread may ask for actions while another learns. What is learned takes the place of what was known
all at once, and with it what one acts on; until then it stays what it is, to the byte.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pacnet.competition.competing_schemas import CompetingSchemas
from pacnet.competition.recognition import Watcher
from pacnet.core.drafts import Tensors, frozen
from pacnet.schemas.motor_schemas import MotorSchemas
from pacnet.schemas.sequences import compact

if TYPE_CHECKING:
    from pacnet.attention.sofm import HabituatingSOFM


def check_nodes(sofm: HabituatingSOFM, schemas: MotorSchemas | CompetingSchemas) -> None:
    """Raises a ValueError unless each node has motor schemas, with cues like its percepts."""
    width, cues = sofm.nodes.live("prototype").shape[1:], schemas.pool.live("cue").shape[1:]
    if width != cues:
        raise ValueError(
            f"expected cues as long as prototypes, {list(width)}, got them {list(cues)}"
        )
    if len(sofm) != len(schemas):
        raise ValueError(
            f"expected motor schemas for each node, got {len(schemas)} for {len(sofm)} nodes"
        )


class Acting:
    """A recall episode of a map and its motor schemas, as they are now.

    Args:
        sofm: of the network.
        schemas: of the network; gaps between their sequences are closed.

    Attributes:
        sofm: the map, which shares its tensors and keeps them.
        schemas: likewise.

    Raises:
        ValueError: buffers that contradict one another.
    """

    def __init__(self, sofm: HabituatingSOFM, schemas: MotorSchemas | CompetingSchemas) -> None:
        check_nodes(sofm, schemas)
        schemas.check()
        compact(schemas)
        self.sofm, self.schemas = frozen(sofm), frozen(schemas)
        if isinstance(self.schemas, CompetingSchemas) and isinstance(schemas, CompetingSchemas):
            self.schemas.share_recall(schemas)
        elif isinstance(self.schemas, MotorSchemas):
            self.schemas.hold_still()
        self._watcher: Watcher | None = None
        self.follow(sofm, schemas)

    def follow(self, sofm: HabituatingSOFM, schemas: MotorSchemas | CompetingSchemas) -> None:
        """From now on `is_of` means these, which have the same tensors."""
        # Of the map's own, what recall reads.
        self._tensors = Tensors(schemas, of=[(sofm.nodes, "prototype"), (sofm, "scale")])
        self._configs = sofm.config, schemas.config

    def is_of(self, sofm: Any, schemas: Any) -> bool:
        """Whether these are as they were."""
        same = sofm.config is self._configs[0] and schemas.config is self._configs[1]
        return same and self._tensors.are_current()

    def watcher(self) -> Watcher:
        """Who watches this episode.

        Raises:
            ValueError: one schema a node, or nothing learned yet: there is nothing to recognise.
        """
        if not isinstance(self.schemas, CompetingSchemas):
            raise ValueError(
                "expected CompetingSchemasConfig to recognise with, got one schema a node"
            )
        if self._watcher is None:
            self._watcher = Watcher(self.schemas)
        return self._watcher

    def reset(self) -> None:
        """Begins a new episode."""
        self.schemas.reset()
        self._watcher = None
