"""What hangs a turned mug: the imitator with and without points, the nearest frame, and replay.

The nearest frame is described relative to the hand, along the axes of the world or of the mug; in
the latter case its action is turned with the mug too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.metaworld.baselines import Frames, Replay
from benchmarks.turned_world import MARKS, Variant, turned
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.imitator import Imitator
from pacnet.imitator.points import find_points
from pacnet.schemas.points import Points

Floats = NDArray[np.floating]


class Learner(Protocol):
    """Learns from demonstrations, then acts on one percept after the other."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Learn once, from nothing."""
        ...

    def reset(self) -> None:
        """Start an episode."""
        ...

    def act(self, percept: Floats) -> Floats | None:
        """Return the action `[U]` at a percept `[D]`; None to hold."""
        ...


class Imitating:
    """`pacnet.Imitator`.

    Args:
        choose: which points it is given, of those that the names say.
    """

    def __init__(self, choose: Callable[[Points], Points | None]) -> None:
        self._choose = choose

    def learn(self, demonstrations: Demonstrations) -> None:
        """Make an imitator and let it learn."""
        found = find_points(demonstrations.percept_features, demonstrations.state_features).points
        assert found is not None
        points = self._choose(found)
        self.imitator = Imitator.from_demonstrations(demonstrations, points=points)
        self.imitator.learn(demonstrations)

    def reset(self) -> None:
        """Start an episode."""
        self.imitator.reset()

    def act(self, percept: Floats) -> Floats | None:
        """Return its action, None where the percept is novel."""
        return self.imitator.step(percept.astype(np.float32)).action


class Nearest:
    """The action of the nearest frame.

    Args:
        variant: of the world.
        of_mug: whether places and actions are along the mug's axes.
    """

    def __init__(self, variant: Variant, *, of_mug: bool) -> None:
        self._variant, self._of_mug = variant, of_mug
        self._at = {name: at for at, name in enumerate(variant.percept_names)}

    def learn(self, demonstrations: Demonstrations) -> None:
        """Keep all frames."""
        percepts = np.concatenate([one.percepts.numpy() for one in demonstrations])
        actions = np.concatenate([one.action.numpy() for one in demonstrations])
        rows = [self._described(percept) for percept in percepts]
        pairs = zip(percepts, actions, strict=True)
        kept = [self._turned_action(action, -self._axes(percept)) for percept, action in pairs]
        self._frames = Frames(np.array(rows), np.array(kept))

    def reset(self) -> None:
        """Do nothing: it remembers nothing."""

    def act(self, percept: Floats) -> Floats:
        """Return the action of the nearest frame `[U]`."""
        query = self._frames.scaled(self._described(percept))
        row = self._frames.nearest(query, 1)[0]
        return self._turned_action(self._frames.actions[row], self._axes(percept))

    def _described(self, percept: Floats) -> Floats:
        """Return the gripper, and places and yaws relative to one another, `[F]`."""
        percept = percept.astype(np.float64)
        hand, mug, board = (self._place(percept, name) for name in ("hand", *MARKS))
        yaws = [self._yaw(percept, name) for name in MARKS]
        if self._variant.hand_turns:
            yaws = [yaw - percept[self._at["hand.yaw"]] for yaw in yaws] + yaws
        if self._of_mug:
            yaws[-2:] = [yaws[-1] - yaws[-2]]
        between = turned(np.stack([mug - hand, board - hand, board - mug]), -self._axes(percept))
        return np.array([percept[self._at["gripper"]], *between.ravel(), *yaws])

    def _place(self, percept: Floats, name: str) -> Floats:
        first = self._at[f"{name}.x"]
        return percept[first : first + self._variant.dimensions]

    def _yaw(self, percept: Floats, name: str) -> float:
        if self._variant.quaternion:
            w, z = percept[self._at[f"{name}.qw"]], percept[self._at[f"{name}.qz"]]
            return float(2 * np.arctan2(z, w))
        return float(percept[self._at[f"{name}.yaw"]])

    def _axes(self, percept: Floats) -> float:
        """Return by how much the axes are turned that it describes in."""
        return self._yaw(percept, MARKS[0]) if self._of_mug else 0.0

    def _turned_action(self, action: Floats, yaw: float) -> Floats:
        size = self._variant.dimensions
        return np.append(turned(action[:size], yaw), action[size:])


def without_orientations(points: Points) -> Points:
    """Return the places of points alone."""
    moved, *landmarks = (replace(point, orientation=()) for point in points)
    return Points(moved, tuple(landmarks))


LEARNERS: dict[str, Callable[[Variant], Learner]] = {
    "`Imitator`": lambda _: Imitating(lambda points: points),
    "its places alone": lambda _: Imitating(without_orientations),
    "no points": lambda _: Imitating(lambda _: None),
    "1-NN": lambda variant: Nearest(variant, of_mug=False),
    "1-NN, mug's axes": lambda variant: Nearest(variant, of_mug=True),
    "replay": lambda _: Replay(),
}
"""Learners in the order of the table, by what it calls them."""
