"""Where a recalled target came from, and which other schemas competed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.competition.confidences import SchemaConfidences
from pacnet.competition.timeline import shown_samples
from pacnet.core.old_names import old_names
from pacnet.core.validation import check_index
from pacnet.schemas.memory import EpisodicMemory


class Origin(NamedTuple):
    """A sample of a demonstration."""

    episode: int
    """Number of the episode, as it was observed."""
    behaviour: str
    """Its behaviour."""
    frame: int
    """Index of the sample in its episode."""


@old_names(position="offset")
class Rival(NamedTuple):
    """A schema that competes."""

    schema: int
    """Its id."""
    node: int
    """Its node."""
    confidence: float
    """The probability of a visit to it, times its activation by the percept."""
    offset: int
    """Of its cue nearest to the percept."""
    behaviours: tuple[str, ...]
    """Those of the episodes that visited it, in order of first use."""


def origins_of(memory: EpisodicMemory, schema: int, offset: int) -> list[Origin]:
    """See `CompetingSchemas.origins`."""
    memory.check()
    schema = check_index("a schema", schema, len(memory.blocks))
    length = int(memory.lengths[schema])
    offset = check_index("an offset", offset, length)
    visits, episodes, frames = memory.visits, memory.episodes, memory.frames(schema)
    visit, time, row = shown_samples(memory)
    here = row == memory.blocks.live("start")[schema] + offset
    visit, frame = visit[here], time[here].round().long()
    first, last = visits.live("first")[visit], visits.live("last")[visit]
    episode = visits.live("episode")[visit]
    names = [memory.behaviours[kind] for kind in episodes.live("behaviour")[episode].tolist()]
    numbers = episodes.live("number")[episode].tolist()
    origins = [Origin(*row) for row in zip(numbers, names, frame.tolist(), strict=True)]
    # The visit whose sequence is kept began with its first row and ended with its last one.
    own = (first == frames[0]) & (last == frames[-1])
    own &= episode == memory.blocks.live("shown_in")[schema]
    if not bool(own.any()):
        raise ValueError(f"expected a visit in which schema {schema} was shown, got none")
    return [origins.pop(int(own.nonzero()[0])), *origins]


def rivals_of(
    memory: EpisodicMemory,
    here: SchemaConfidences,
    distances: NDArray[np.floating],
    probability: NDArray[np.float64],
) -> list[Rival]:
    """See `CompetingSchemas.rivals`; arguments as of `SchemaConfidences.confidences`."""
    confidences = here.confidences(distances, probability).tolist()
    rivals = []
    for index, schema in enumerate(here.ids):
        offset = int(distances[here.rows_of(index)].argmin())
        node, names = int(memory.blocks.live("node")[schema]), _behaviours_of(memory, schema)
        rivals.append(Rival(schema, node, confidences[index], offset, names))
    return sorted(rivals, key=lambda rival: -rival.confidence)


def _behaviours_of(memory: EpisodicMemory, schema: int) -> tuple[str, ...]:
    visited = memory.visits.live("schema") == schema
    kinds = memory.episodes.live("behaviour")[memory.visits.live("episode")[visited]]
    return tuple(memory.behaviours[kind] for kind in kinds.unique().tolist())
