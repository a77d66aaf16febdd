"""What an imitator returns: a report for each demonstration learned, a record for each step."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.core.old_names import old_names
from pacnet.core.validation import check_index, is_number


@old_names(unfamiliar="max_novelty")
class EpisodeReport(NamedTuple):
    """What learning one demonstration, or one part of it between gaps, changed."""

    dataset: str
    """Name of its dataset."""
    episode: int
    """Its number in the dataset."""
    task: str
    """What was shown, in words."""
    frames: int
    """Number of frames, T."""
    new_nodes: int
    """Number of nodes added to the map."""
    nodes: int
    """Number of nodes of the map afterwards."""
    novel_share: float
    """Share of its frames that were novel to the map when they came."""
    max_novelty: float | None
    """Its largest novelty before it was learned, as in `ImitatorStep`; None for the first."""
    correction: bool = False
    """Whether it showed what to do where percepts were novel."""
    first_frame: int = 0
    """The frame of its episode with which it begins."""


class Followed(NamedTuple):
    """One of the demonstrations that decide what an imitator does."""

    demonstration: int
    """Index of its report in `Imitator.reports`."""
    frame: int
    """The moment in it that is now, counted from its own first frame."""
    weight: float
    """Its share in the action; those of all sum to 1."""


@old_names(tolerated="threshold")
class ImitatorStep(NamedTuple):
    """What the imitator does at one percept of a control loop."""

    action: NDArray[np.float32] | None
    """`[U]`; None where the percept is novel, where nothing was shown for the task, or where a
    forward model finds none. The caller holds, or asks for help."""
    is_novel: bool
    """Whether the percept is unlike all training data."""
    novelty: float
    """Deviation from the training data over the threshold, in the dimension where that is largest;
    above 1 the percept is novel."""
    dimension: str
    """Name of that dimension."""
    deviation: float
    """Signed difference from the nearest percept learned, in that dimension and its own unit."""
    threshold: float
    """Deviation above which percepts are novel, in the same dimension and unit."""
    progress: float
    """Share of what is followed that is over, from 0 to 1."""
    is_done: bool
    """Whether the demonstration with the largest weight is at its end."""
    followed: tuple[Followed, ...]
    """The demonstrations that decide; none before anything was learned."""
    target: NDArray[np.float32] | None
    """What is aimed at, `[A]`: the action itself, or a state and the actions that do not move it;
    None with nothing to follow."""
    landmark: str | None = None
    """In whose frame of reference that is; None without frames."""
    segment: int | None = None
    """Number of the segment, within the demonstration, that goes there; None without frames."""


def task_name(task: str) -> str:
    """Return a task's text without what nobody sees: blanks around it, and several in a row."""
    return " ".join(task.split())


def read_reports(rows: Any) -> list[EpisodeReport]:
    """Return the reports that a checkpoint's config holds.

    Raises:
        ValueError: not a list of reports.
    """
    try:
        reports = [EpisodeReport(**row) for row in rows]
    except (AttributeError, TypeError) as error:
        raise ValueError(f"expected the episode reports of an Imitator, got: {error}") from error
    for report in reports:
        for name in ("episode", "frames", "new_nodes", "nodes", "first_frame"):
            check_index(f"{name} in a report", getattr(report, name), 2**63)
        if not (isinstance(report.task, str) and isinstance(report.dataset, str)):
            raise ValueError(f"expected a task and a dataset as str in a report, got {report}")
        if not (isinstance(report.correction, bool) and _is_share(report.novel_share)):
            raise ValueError(f"expected a share and a flag in a report, got {report}")
    return reports


def _is_share(value: object) -> bool:
    return is_number(value) and 0 <= value <= 1  # pyright: ignore[reportOperatorIssue]
