"""The table of lessons: what was new in each episode that was learned, and what is left of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from pacnet.cli.printing import over_tolerated, print_table

if TYPE_CHECKING:
    from pacnet.imitator.imitator import Imitator

_HEADS = (
    "<dataset", "episode", "<task", "frames", "new nodes", "nodes", "remembered", "unfamiliar",
)  # fmt: skip
_LEGEND = """remembered: its frames that motor schemas stand for; of the others no targets were kept
unfamiliar: its largest novelty before it was learned, over what is tolerated; over 1 is new"""


def lessons_of(imitator: Imitator) -> list[dict[str, Any]]:
    """All that was learned, as JSON holds it: each lesson, and the share that is remembered."""
    import numpy as np

    from pacnet.competition.competing_schemas import CompetingSchemas

    schemas = imitator.network.schemas
    assert isinstance(schemas, CompetingSchemas)  # of every imitator
    visits = {name: schemas.visits.live(name).numpy() for name in schemas.visits.columns}
    numbers = schemas.episodes.live("number").numpy()[visits["episode"]]
    lessons = []
    for number, lesson in enumerate(imitator.lessons):
        remembered = np.zeros(lesson.frames, dtype=bool)
        own = numbers == number
        for first, last in zip(visits["first"][own], visits["last"][own], strict=True):
            remembered[first : last + 1] = True
        lessons.append(lesson._asdict() | {"remembered_share": float(remembered.mean())})
    return lessons


def print_lessons(lessons: Iterable[Mapping[str, Any]]) -> None:
    """Prints a row for each of them, as `lessons_of` gives them, and what the columns mean."""
    print_table(_HEADS, map(_row, lessons))
    print(_LEGEND)


def _row(lesson: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        lesson["dataset"],
        f"{lesson['episode']}",
        lesson["task"] or "untitled",
        f"{lesson['frames']:,}",
        f"{lesson['new_nodes']}",
        f"{lesson['nodes']}",
        f"{lesson['remembered_share']:.1%}",
        over_tolerated(lesson["unfamiliar"]),
    )
