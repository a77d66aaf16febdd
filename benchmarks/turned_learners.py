"""What hangs a turned mug: the imitator with and without points, the nearest frame, and replay.

Without points, or with places alone, the imitator is given percepts without orientations: those of
mug and board would be novel in every new scene. The nearest frame is described relative to the
hand, along the axes of the world or of the mug; in the latter case its action is turned with the
mug too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, Protocol

import numpy as np

from benchmarks.metaworld.baselines import Frames, Replay
from benchmarks.turned_world import MARKS, Floats, Variant, turned
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.imitator import Imitator


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
        points: which it is given: those that are found by their names, or none.
    """

    def __init__(self, points: Literal["auto"] | None = "auto") -> None:
        self._points: Literal["auto"] | None = points

    def learn(self, demonstrations: Demonstrations) -> None:
        """Make an imitator and let it learn."""
        self.imitator = Imitator.from_demonstrations(demonstrations, points=self._points)
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


class WithoutOrientations:
    """A learner that does not perceive how mug and board are turned.

    Args:
        variant: of the world.
        learner: what learns from the rest.
    """

    def __init__(self, variant: Variant, learner: Learner) -> None:
        self._learner, self._names = learner, variant.percept_names
        self._own = len(variant.state_names)
        kept = [*range(self._own)]
        for mark in MARKS:
            first = self._names.index(f"{mark}.x")
            kept += range(first, first + variant.dimensions)
        self._kept = kept

    def learn(self, demonstrations: Demonstrations) -> None:
        """Let it learn from the rest of the percepts."""
        of_surroundings = self._kept[self._own :]
        columns = [number - self._own for number in of_surroundings]
        feature = "observation.environment_state"
        names = {**demonstrations.names, feature: tuple(self._names[i] for i in of_surroundings)}
        episodes = tuple(
            replace(one, environment_state=one.environment_state[:, columns])
            for one in demonstrations
        )
        self._learner.learn(replace(demonstrations, names=names, episodes=episodes))

    def reset(self) -> None:
        """Start an episode."""
        self._learner.reset()

    def act(self, percept: Floats) -> Floats | None:
        """Return its action; None to hold."""
        return self._learner.act(percept[self._kept])


LEARNERS: dict[str, Callable[[Variant], Learner]] = {
    "`Imitator`": lambda _: Imitating(),
    "places alone": lambda variant: WithoutOrientations(variant, Imitating()),
    "no points": lambda variant: WithoutOrientations(variant, Imitating(None)),
    "1-NN": lambda variant: Nearest(variant, of_mug=False),
    "1-NN, mug's axes": lambda variant: Nearest(variant, of_mug=True),
    "replay": lambda _: Replay(),
}
"""Learners in the order of the table, by what it calls them."""
