"""Results on disk, a file for each cell, so that a run goes on where it stopped.

Every file is complete or absent. Several runs may write into one folder.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

from benchmarks.metaworld.features import View
from pacnet.core.durable import make_folder, write_atomically

EXPERTS = "failed_experts.json"


@dataclass(frozen=True)
class Cell:
    """What is measured at once: a learner that learned some demonstrations of a task.

    Attributes:
        task: its name.
        draw: which choice of demonstrations, from 0.
        demonstrations: how many.
        learner: out of `LEARNERS`.
        view: how places are perceived.
        sight: what is different in the pictures that a camera takes, out of `camera.SIGHTS`; '' for
            nothing, and without a camera.
    """

    task: str
    draw: int
    demonstrations: int
    learner: str
    view: View = field(default_factory=View)
    sight: str = ""

    @property
    def file(self) -> str:
        """Name of its file."""
        seen = str(self.view).replace(", ", "-").replace(" ", "")
        numbers = str(self.draw), str(self.demonstrations)
        parts = (self.task, *numbers, self.learner, seen, self.sight)
        return "-".join(part for part in parts if part) + ".json"


class Result(NamedTuple):
    """What was measured, over all episodes of a cell."""

    successes: list[bool]
    steps: list[int]
    """Of each episode."""
    held: float
    """Share of the steps without an action."""
    learning_s: float
    """Time to learn all demonstrations [s]."""
    step_us: float
    """Median time of a step of the learner [µs]."""
    first_held: list[int] | None = None
    """With a camera, the first step without an action of each episode; 0 for none."""
    reached: list[int] | None = None
    """With a camera, the first step with the hand where the object was at first; 0 for none."""
    note: str = ""
    """What a learner tells of what it learned."""

    @property
    def success(self) -> float:
        """Share of the episodes."""
        return sum(self.successes) / len(self.successes)


class Results:
    """The results in a folder.

    Args:
        folder: is made when something is kept.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def keep(self, cell: Cell, result: Result) -> None:
        """Write a result, in place of an earlier one."""
        self._write(cell.file, {"cell": asdict(cell), "result": result._asdict()})

    def has(self, cell: Cell, episodes: int) -> bool:
        """Return whether a cell was measured over so many episodes."""
        path = self.folder / cell.file
        return path.exists() and len(_read(path)[1].successes) == episodes

    def all(self) -> dict[Cell, Result]:
        """Return all results but those of tasks left out, in the order of their files' names."""
        paths, failed = sorted(self.folder.glob("*.json")), self.failed_experts
        read = dict(_read(path) for path in paths if path.name != EXPERTS)
        return {cell: result for cell, result in read.items() if cell.task not in failed}

    @property
    def failed_experts(self) -> dict[str, str]:
        """Tasks that are left out, each with what its expert achieved."""
        path = self.folder / EXPERTS
        return json.loads(path.read_text("utf-8")) if path.exists() else {}

    def leave_out(self, task: str, reason: str) -> None:
        """Remember that a task's expert fails."""
        self._write(EXPERTS, self.failed_experts | {task: reason})

    def _write(self, name: str, content: object) -> None:
        make_folder(self.folder)
        write_atomically(self.folder / name, (json.dumps(content) + "\n").encode())


def _read(path: Path) -> tuple[Cell, Result]:
    """Return one cell with its result."""
    content = json.loads(path.read_text("utf-8"))
    view = View(**content["cell"].pop("view"))
    return Cell(**content["cell"], view=view), Result(**content["result"])
