"""Learners of drawings: the imitator, blended replay and the nearest neighbour."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.lasa_data import Array, Drawing, as_demonstrations, interpolate
from benchmarks.lasa_protocol import APPROACH, Policy
from pacnet.imitator.imitator import Imitator


class Imitating:
    """`pacnet.Imitator` with its automatic settings."""

    def __init__(self, shown: Sequence[Drawing]) -> None:
        demonstrations = as_demonstrations(shown)
        self.imitator = Imitator.from_demonstrations(demonstrations)
        self.imitator.learn(demonstrations)
        self._thresholds: list[float] = []  # of each step [mm]

    @property
    def tolerance(self) -> float:
        """Return the mean threshold since `begin` [mm]."""
        return float(np.mean(self._thresholds)) if self._thresholds else math.nan

    def begin(self, start: Array) -> None:  # noqa: ARG002  # the percepts tell it
        """Start a new episode."""
        self.imitator.reset()
        self._thresholds.clear()

    def step(self, place: Array) -> Array | None:
        """Return the imitator's action, None where the place is novel."""
        step = self.imitator.step(place.astype(np.float32))
        self._thresholds.append(step.threshold)
        return step.action


class BlendedReplay:
    """The mean of what was shown, by time, moved to where the point starts.

    The nearer a drawing's start, the more it counts. The offset of the start fades linearly. The
    action is on the way that the mean takes, so that a spring of `APPROACH` corrects pushes.
    """

    tolerance = math.nan

    def __init__(self, shown: Sequence[Drawing]) -> None:
        phase = np.linspace(0, 1, max(len(one.places) for one in shown))
        self._paths = np.stack(
            [interpolate(phase, np.linspace(0, 1, len(one.places)), one.places) for one in shown]
        )  # [drawings, T, 2]
        self._lead = APPROACH * shown[0].hz  # [frames]
        self._actions = self._paths[0]
        self._now = 0

    def begin(self, start: Array) -> None:
        """Plan the whole way from a start `[2]`."""
        closeness = 1 / (np.hypot(*(self._paths[:, 0] - start).T) + 1e-3)
        mean = np.tensordot(closeness / closeness.sum(), self._paths, axes=1)
        way = mean + (start - mean[0]) * np.linspace(1, 0, len(mean))[:, None]
        self._actions = way + self._lead * np.diff(way, axis=0, append=way[-1:])
        self._now = 0

    def step(self, place: Array) -> Array:  # noqa: ARG002
        """Return what comes next, wherever the point is."""
        action = self._actions[min(self._now, len(self._actions) - 1)]
        self._now += 1
        return action


class NearestNeighbour:
    """The action of the frame whose place is nearest, of all that were shown."""

    tolerance = math.nan

    def __init__(self, shown: Sequence[Drawing]) -> None:
        self._places = np.concatenate([one.places for one in shown])
        self._actions = np.concatenate([one.actions for one in shown])

    def begin(self, start: Array) -> None:
        """Do nothing: it remembers nothing."""

    def step(self, place: Array) -> Array:
        """Return the nearest frame's action."""
        apart = self._places - place
        return self._actions[np.einsum("td,td->t", apart, apart).argmin()]


IMITATOR, REPLAY, NEAREST = "`Imitator`", "blended replay", "nearest neighbour"
POLICIES: dict[str, Callable[[Sequence[Drawing]], Policy]] = {
    IMITATOR: Imitating,
    REPLAY: BlendedReplay,
    NEAREST: NearestNeighbour,
}
