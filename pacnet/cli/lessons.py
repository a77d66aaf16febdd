"""The table of lessons: what was new in each episode that was learned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pacnet.cli.printing import over_tolerated, print_table

if TYPE_CHECKING:
    from pacnet.imitator import Lesson

_HEADS = (
    "<dataset", "episode", "<task", "frames", "new nodes", "nodes", "unmatched", "unfamiliar",
)  # fmt: skip
_LEGEND = """unmatched: frames that were unlike every node of the map when they came
unfamiliar: its largest novelty before it was learned, over what is tolerated; over 1 is new"""


def print_lessons(lessons: Sequence[Lesson]) -> None:
    """Prints a row for each episode, and what the columns mean."""
    print_table(_HEADS, map(_row, lessons))
    print(_LEGEND)


def _row(lesson: Lesson) -> tuple[str, ...]:
    return (
        lesson.dataset,
        f"{lesson.episode}",
        lesson.task or "untitled",
        f"{lesson.frames:,}",
        f"{lesson.new_nodes}",
        f"{lesson.nodes}",
        f"{lesson.novel_share:.1%}",
        over_tolerated(lesson.unfamiliar),
    )
