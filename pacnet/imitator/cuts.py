"""Where demonstrations are cut, by the landmarks' names."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.schemas.points import Points
from pacnet.schemas.scene import WORLD
from pacnet.schemas.segments import Segments

WORLD_NAME = "world"
"""In place of a landmark: the percepts' own axes."""


class ShownSegment(NamedTuple):
    """A stretch of a demonstration on the way to one landmark."""

    landmark: str
    """Where the moved point is on its way to; `WORLD_NAME` for nowhere."""
    reference: str
    """In whose frame of reference the targets are kept; nearly always that landmark's."""
    first_frame: int
    """Counted from the demonstration's own first frame."""
    frames: int
    """Number of frames."""


class ShownCut(NamedTuple):
    """How a demonstration is cut."""

    segments: tuple[ShownSegment, ...]
    """In order, without gaps; neighbours have different landmarks."""
    is_usual: bool
    """Whether its episode goes where most of its task go, to the end; else it is not followed."""

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Where the moved point goes, in order."""
        return tuple(segment.landmark for segment in self.segments)


class Approach(NamedTuple):
    """How the moved point comes near M landmarks in T frames."""

    distances: NDArray[np.float64]
    """From each landmark, smoothed, `[T, M]`, in the percept's unit."""
    landmark: NDArray[np.int64]
    """Number of the one that it is on its way to, −1 for none, `[T]`."""
    carried: NDArray[np.bool_]
    """Whether each landmark moves with the moved point, `[T, M]`."""


def landmark_name(points: Points, number: int) -> str:
    """Return the name of a landmark, `WORLD_NAME` for none."""
    return WORLD_NAME if number == WORLD else points.landmarks[number].name


def cuts_of(
    segments: Segments,
    attended: NDArray[np.int64],
    frame: NDArray[np.int64],
    points: Points,
    demonstrations: int,
) -> tuple[ShownCut, ...]:
    """Return how each of E demonstrations is cut; of one that is forgotten there are no segments.

    Args:
        segments: of all demonstrations.
        attended: which landmark each of them is on the way to, `[S]`.
        frame: number of each row in its demonstration, as it was shown, `[R]`.
        points: of the percepts.
        demonstrations: number E of them.
    """
    begin, end = frame[segments.first], frame[segments.end - 1] + 1
    goes_on = np.flatnonzero(np.diff(segments.demonstration) == 0)
    end[goes_on] = begin[goes_on + 1]
    cuts = []
    for number in range(demonstrations):
        own = np.flatnonzero(segments.demonstration == number).tolist()
        shown = tuple(
            ShownSegment(
                landmark_name(points, attended[one].item()),
                landmark_name(points, segments.landmark[one].item()),
                begin[one].item(),
                (end[one] - begin[one]).item(),
            )
            for one in own
        )
        cuts.append(ShownCut(shown, any(segments.usual[own[:1]])))
    return tuple(cuts)
