"""What ten lines can do with pictures: neighbours in pixels, a small network, and replay.

All see pictures of 16 × 16 pixels, of which they keep the first few principal components.
"""

from __future__ import annotations

import numpy as np
import torch

from benchmarks.metaworld.baselines import Frames, Network, regress
from benchmarks.metaworld.camera.recording import CAMERA
from benchmarks.metaworld.camera.world import Picture
from benchmarks.metaworld.features import GRIPPER, Array
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator

SIDE = 16  # [pixels]
COMPONENTS = 8  # of pictures
FIRST_COMPONENTS = 4  # of first pictures
PHASES = np.array([0, 0.25, 0.5, 0.75, 1])  # of an episode
GAIN = 10.0  # action per metre from the hand to where it should be
RIDGE = 1e-2


def reduced(pictures: Array) -> Array:
    """Return the means of square parts of pictures `[..., H, H, 3]`, `[..., 3 SIDE²]`."""
    side = pictures.shape[-2] // SIDE
    parts = pictures.reshape(*pictures.shape[:-3], SIDE, side, SIDE, side, 3)
    return parts.mean(axis=(-4, -2), dtype=np.float32).reshape(*pictures.shape[:-3], -1) / 255


class Components:
    """Principal components of reduced pictures `[N, 3 SIDE²]`."""

    def __init__(self, rows: Array, number: int) -> None:
        self._mean = rows.mean(axis=0)
        _, sizes, axes = np.linalg.svd(rows - self._mean, full_matrices=False)
        self._axes = axes[:number][sizes[:number] > 1e-6 * sizes[0]]

    def __call__(self, rows: Array) -> Array:
        """Return the components `[..., K]` of reduced pictures."""
        return (rows - self._mean) @ self._axes.T


class _OfPixels:
    """Learns actions from the state and a picture's components, and remembers nothing."""

    sees, note = True, ""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Keep all frames."""
        states = np.concatenate([shown.state.numpy() for shown in demonstrations])
        actions = np.concatenate([shown.action.numpy() for shown in demonstrations])
        rows = np.concatenate([reduced(shown.pictures[CAMERA]) for shown in demonstrations])
        self._components = Components(rows, COMPONENTS)
        self._frames = Frames(np.concatenate([states, self._components(rows)], axis=1), actions)

    def _query(self, state: Array, picture: Picture) -> Array:
        """Return what is perceived, scaled as the frames are."""
        seen = self._components(reduced(picture))
        return self._frames.scaled(np.concatenate([state, seen]))

    def reset(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class Pixels(_OfPixels):
    """The action of the nearest frame."""

    def act(self, state: Array, picture: Picture) -> Array:
        """Return the action `[4]`."""
        return self._frames.actions[self._frames.nearest(self._query(state, picture), 1)[0]]


class BehaviourCloning(_OfPixels):
    """A network from the state and a picture's components to the action."""

    def learn(self, demonstrations: Demonstrations) -> None:
        """Train the network."""
        super().learn(demonstrations)
        self._network = Network().fit(self._frames.rows[:, None], self._frames.actions)

    def act(self, state: Array, picture: Picture) -> Array:
        """Return the action `[4]`."""
        return self._network.predict(self._query(state, picture)[None])


class NearestGoals:
    """The action of the nearest frame, by state and by the way to what the imitator's camera tells.

    It has the encoder that the imitator chooses, and looks at the first picture.
    """

    note = ""
    _goals: Array | None = None

    @property
    def sees(self) -> bool:
        """Whether it wants a picture at the next step: only at the first."""
        return self._goals is None and self._encoder is not None

    def learn(self, demonstrations: Demonstrations) -> None:
        """Fit the encoder and keep all frames."""
        cameras = Imitator.from_demonstrations(demonstrations).cameras
        self._encoder = None if cameras is None else cameras.encoders[CAMERA]
        rows = []
        for shown in demonstrations:
            goals = self._told(shown.pictures[CAMERA][0])
            rows.append(_with_ways(shown.state.numpy(), goals))
        actions = np.concatenate([shown.action.numpy() for shown in demonstrations])
        self._frames = Frames(np.concatenate(rows), actions)

    def reset(self) -> None:
        """Look anew at the next picture."""
        self._goals = None

    def close(self) -> None:
        """Do nothing."""

    def act(self, state: Array, picture: Picture | None) -> Array:
        """Return the action `[4]`."""
        if self._goals is None:
            self._goals = self._told(picture)
        query = self._frames.scaled(_with_ways(state, self._goals))
        return self._frames.actions[self._frames.nearest(query, 1)[0]]

    def _told(self, picture: Picture | None) -> Array:
        """Return the goals `[G, 3]` that a picture tells; none where no camera helps."""
        if self._encoder is None or picture is None:
            return np.empty((0, GRIPPER))
        goals = self._encoder.look(torch.tensor(picture)).goals
        return goals.numpy().reshape(-1, GRIPPER)


class Replay:
    """The actions of the demonstration whose first picture is nearest."""

    note = ""
    _chosen: Demonstration | None = None

    @property
    def sees(self) -> bool:
        """Whether it wants a picture at each step: only until it has chosen."""
        return self._chosen is None

    def learn(self, demonstrations: Demonstrations) -> None:
        """Keep all actions and the first pictures."""
        self._shown = list(demonstrations)
        self._firsts = np.stack([reduced(shown.pictures[CAMERA][0]) for shown in self._shown])

    def reset(self) -> None:
        """Choose anew at the next picture."""
        self._chosen, self._now = None, 0

    def close(self) -> None:
        """Do nothing."""

    def act(self, state: Array, picture: Picture | None) -> Array:
        """Return the next action `[4]`, the last one once the demonstration is over."""
        if self._chosen is None:
            assert picture is not None
            self._chosen = self._choose(reduced(picture))
        at = min(self._now, len(self._chosen.action) - 1)
        self._now += 1
        return self._corrected(self._chosen.action[at].numpy(), at, state)

    def _choose(self, first: Array) -> Demonstration:
        """Return the demonstration whose first picture is nearest."""
        return self._shown[int(np.square(self._firsts - first).sum(axis=1).argmin())]

    def _corrected(self, action: Array, at: int, state: Array) -> Array:
        """Return the action to be sent."""
        del at, state
        return action


class ShiftedReplay(Replay):
    """Replay along a path that is shifted to where the hand will be, as the first picture tells.

    A regression from the first picture's components tells where the hand will be at some phases of
    the episode. What the hand is off the shifted path corrects the shown actions.
    """

    def learn(self, demonstrations: Demonstrations) -> None:
        """Keep all demonstrations and what the regression needs."""
        super().learn(demonstrations)
        self._components = Components(self._firsts, FIRST_COMPONENTS)
        self._inputs = self._components(self._firsts)
        self._paths = np.stack([_at_phases(shown.state.numpy()) for shown in self._shown])

    def _choose(self, first: Array) -> Demonstration:
        """Return the demonstration whose path is nearest to the one that is foretold."""
        count, paths = len(self._paths), self._paths.reshape(len(self._paths), -1)
        apart = self._inputs - self._components(first)
        foretold = regress(apart, paths, np.full(count, 1 / count), RIDGE)
        foretold = foretold.reshape(self._paths.shape[1:])
        chosen = int(np.square(self._paths - foretold).sum(axis=(1, 2)).argmin())
        shift, shown = foretold - self._paths[chosen], self._shown[chosen]
        hand = shown.state.numpy()[:, :GRIPPER]
        when = np.linspace(0, 1, len(hand))
        shifts = [np.interp(when, PHASES, shift[:, axis]) for axis in range(GRIPPER)]
        self._path = hand + np.stack(shifts, axis=1)
        return shown

    def _corrected(self, action: Array, at: int, state: Array) -> Array:
        """Return the action with what takes the hand to the path."""
        return action + np.append(GAIN * (self._path[at] - state[:GRIPPER]), 0)


def _at_phases(states: Array) -> Array:
    """Return the hand's places `[P, 3]` at the phases of an episode of states `[T, 4]`."""
    frames = np.round(PHASES * (len(states) - 1)).astype(int)
    return states[frames, :GRIPPER]


def _with_ways(states: Array, goals: Array) -> Array:
    """Return states `[..., 4]` with the way from the hand to each goal `[G, 3]`."""
    ways = goals - states[..., None, :GRIPPER]
    return np.concatenate([states, ways.reshape(*states.shape[:-1], -1)], axis=-1)
