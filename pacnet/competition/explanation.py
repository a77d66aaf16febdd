"""Where a recalled target came from, and what else might have been recalled in its place."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.competition.confidences import NodeSchemas
from pacnet.competition.timeline import shown
from pacnet.core.validation import check_number

if TYPE_CHECKING:
    from pacnet.competition.competing_schemas import CompetingSchemas


class Origin(NamedTuple):
    """A moment of a demonstration."""

    episode: int
    """Number of the episode, as it was observed."""
    behaviour: str
    """What was shown in it."""
    frame: int
    """Which of the episode's samples, from 0."""


class Rival(NamedTuple):
    """A schema that competes."""

    schema: int
    """Its number."""
    node: int
    """Whose it is."""
    confidence: float
    """The probability that what is watched is a pass through it, times how well it fits."""
    position: int
    """Place in it of the cue nearest to the percept."""
    behaviours: tuple[str, ...]
    """Of the episodes that passed through it, in the order in which they were first shown."""


def origins_of(schemas: CompetingSchemas, schema: int, position: int) -> list[Origin]:
    """See `CompetingSchemas.origins`."""
    schemas.check()
    schema, position = _check(schemas, schema, position)
    passes, episodes, frames = schemas.passes, schemas.episodes, schemas.frames(schema)
    number, time, row = shown(schemas)
    blocks = schemas.blocks
    here = row == blocks.live("start")[schema] + position
    number, frame = number[here], time[here].round().long()
    first, last = passes.live("first")[number], passes.live("last")[number]
    episode = passes.live("episode")[number]
    names = [schemas.behaviours[kind] for kind in episodes.live("behaviour")[episode].tolist()]
    numbers = episodes.live("number")[episode].tolist()
    origins = [Origin(*row) for row in zip(numbers, names, frame.tolist(), strict=True)]
    # The pass whose sequence is kept began with its first row and ended with its last one.
    own = (first == frames[0]) & (last == frames[-1]) & (episode == blocks.live("shown_in")[schema])
    if not bool(own.any()):
        raise ValueError(f"expected a pass in which schema {schema} was shown, got none")
    return [origins.pop(int(own.nonzero()[0])), *origins]


def rivals_of(
    schemas: CompetingSchemas,
    here: NodeSchemas,
    distances: NDArray[np.floating],
    probability: NDArray[np.float64],
) -> list[Rival]:
    """See `CompetingSchemas.rivals`; arguments as of `NodeSchemas.confidences`."""
    confidences = here.confidences(distances, probability).tolist()
    rivals = []
    for place, schema in enumerate(here.numbers):
        position = int(distances[here.rows_of(place)].argmin())
        node, names = int(schemas.blocks.live("node")[schema]), _behaviours_through(schemas, schema)
        rivals.append(Rival(schema, node, confidences[place], position, names))
    return sorted(rivals, key=lambda rival: -rival.confidence)


def _behaviours_through(schemas: CompetingSchemas, schema: int) -> tuple[str, ...]:
    through = schemas.passes.live("schema") == schema
    kinds = schemas.episodes.live("behaviour")[schemas.passes.live("episode")[through]]
    return tuple(schemas.behaviours[kind] for kind in kinds.unique().tolist())


def _check(schemas: CompetingSchemas, schema: int, position: int) -> tuple[int, int]:
    schema = check_number("a schema", schema, len(schemas.blocks))
    length = int(schemas.lengths[schema])
    return schema, check_number("a position", position, length, 0, f" in schema {schema}")
