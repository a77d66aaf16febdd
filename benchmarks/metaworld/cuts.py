"""Whether attention cuts demonstrations where a person does: `python -m benchmarks.metaworld.cuts`.

The demonstrations are those that `python -m benchmarks.metaworld` has recorded in its folder.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.harness import Table
from benchmarks.metaworld.__main__ import FOLDER
from benchmarks.metaworld.labels import LABELS, labelled
from benchmarks.metaworld.recording import load
from benchmarks.metaworld.tasks import set_of
from pacnet.attention.cutting import cut, measure, runs
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.points import find_points
from pacnet.schemas.scene import scene_of
from pacnet.schemas.smoothing import choose_smoothing, smooth

NO_LANDMARK = "none"
TEXT = """`python -m benchmarks.metaworld.cuts`: the share of the frames of a demonstration in which
attention says that the hand is on its way to the landmark that a person says it is, and at which
frame either says that the hand sets out for which landmark. One demonstration of each of {count}
tasks; the labels were written down from the trajectories before the cuts were seen, and not changed
since. In all: {agree} of {frames} frames, {share:.1%}. Attention goes by places alone: it cuts once
an object has moved, some frames after the command that a person goes by; what is reached with a
tool and not with the hand, as the nail in hammer, is not attained; and an object at rest beside the
hand counts again once it has been put where it shall be, or has slipped.
"""


class Compared(NamedTuple):
    """One demonstration, both ways."""

    task: str
    person: list[str]
    """Landmark of each frame."""
    attention: list[str]

    @property
    def agreeing(self) -> int:
        """Number of frames in which both are the same."""
        return sum(map(str.__eq__, self.person, self.attention))


def landmarks_by_attention(shown: Demonstrations) -> list[str]:
    """Return the landmark of each frame of the only demonstration, as attention cuts it."""
    points = find_points(shown.percept_features, shown.state_features).points
    assert points is not None
    seen = scene_of(shown.episodes[0].percepts.numpy(), points).places
    places = smooth(seen, choose_smoothing([seen]))
    marks = cut(places, measure([places[:, 0]], shown.fps), shown.fps)
    names = [landmark.name for landmark in points.landmarks]
    return [names[mark] if mark >= 0 else NO_LANDMARK for mark in marks]


def compare(folder: Path) -> list[Compared]:
    """Return all labelled demonstrations.

    Args:
        folder: of the benchmark.

    Raises:
        FileNotFoundError: a demonstration has not been recorded.
    """
    found = []
    for task in LABELS:
        root = folder / "demonstrations" / f"{task}-0"
        if not root.exists():
            raise FileNotFoundError(
                f"expected {root}: record it with `python -m benchmarks.metaworld --tasks {task}`"
            )
        attention = landmarks_by_attention(load(root, 1))
        found.append(Compared(task, labelled(task, len(attention)), attention))
    return found


def table(compared: Sequence[Compared]) -> Table:
    """Return a row for each task."""
    agree = sum(one.agreeing for one in compared)
    frames = sum(len(one.person) for one in compared)
    rows = [
        (
            one.task,
            set_of(one.task),
            str(len(one.person)),
            f"{one.agreeing / len(one.person):.0%}",
            starts(one.person),
            starts(one.attention),
        )
        for one in compared
    ]
    text = TEXT.format(count=len(rows), agree=agree, frames=frames, share=agree / frames)
    columns = ("task", "set", "frames", "agreement", "a person", "attention")
    return Table("Metaworld: where demonstrations are cut", text, columns, rows)


def starts(landmarks: Sequence[str]) -> str:
    """Return at which frames which landmarks begin, as in `0 object, 28 goal`."""
    _, numbers = np.unique(landmarks, return_inverse=True)
    return ", ".join(f"{first} {landmarks[first]}" for first, _ in runs(numbers))


def main() -> None:
    """Compare and print; write if asked to."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.metaworld.cuts",
        description="Compare where attention cuts demonstrations with labels by hand.",
    )
    parser.add_argument("--folder", type=Path, default=FOLDER, help=f"of the benchmark ({FOLDER})")
    parser.add_argument(
        "--write", action="store_true", help="also write the table into docs/benchmarks.md"
    )
    arguments = parser.parse_args()
    try:
        found = str(table(compare(arguments.folder)))
    except FileNotFoundError as error:
        sys.exit(str(error))
    print(found)
    if arguments.write:
        from benchmarks import results_page

        results_page.update("cuts", found)


if __name__ == "__main__":
    main()
