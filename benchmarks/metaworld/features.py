"""What is perceived of a Metaworld observation, and how it is described to the baselines.

Of the 39 numbers, those of the frame before and the quaternions are left out. A percept is the hand
with its gripper, then the places of the object, of a second one where the task has it, and of the
goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import Demonstrations

Array = NDArray[np.floating]
Indices = NDArray[np.integer]

STATE = ("hand.x", "hand.y", "hand.z", "gripper")
ACTION = ("x", "y", "z", "gripper")
GRIPPER = STATE.index("gripper")
LANDMARKS = {"object": 4, "object2": 11, "goal": 36}  # name -> first of its three numbers


def landmarks_of(observation: Array) -> tuple[str, ...]:
    """Return the landmarks that a task has; a second object that it lacks is at zero."""
    at = LANDMARKS["object2"]
    has_second = bool(np.any(observation[at : at + 3] != 0))
    return tuple(name for name in LANDMARKS if name != "object2" or has_second)


def environment_names(landmarks: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the environment state's dimensions."""
    return tuple(f"{name}.{axis}" for name in landmarks for axis in "xyz")


def percept_of(observation: Array, landmarks: Sequence[str]) -> NDArray[np.float32]:
    """Return the percept `[..., 4 + 3 L]` of an observation `[..., 39]`."""
    places = [observation[..., LANDMARKS[name] : LANDMARKS[name] + 3] for name in landmarks]
    return np.concatenate([observation[..., : len(STATE)], *places], axis=-1).astype(np.float32)


def relative(percepts: Array) -> Array:
    """Return what places are to one another, `[..., 10 or 13]`, for percepts `[..., 10 or 13]`.

    They are the gripper, object − hand, goal − hand and goal − object; and second object − hand.
    """
    gripper, places = percepts[..., GRIPPER, None], places_of(percepts)
    hand, thing, goal = places[..., 0, :], places[..., 1, :], places[..., -1, :]
    parts = [gripper, thing - hand, goal - hand, goal - thing]
    parts += [places[..., 2, :] - hand] if places.shape[-2] > 3 else []
    return np.concatenate(parts, axis=-1)


def places_of(percepts: Array) -> Array:
    """Return the places `[..., P, 3]` in percepts `[..., 1 + 3 P]`: hand, landmarks, goal."""
    places = np.delete(percepts, GRIPPER, axis=-1)
    return places.reshape(*places.shape[:-1], -1, 3)


@dataclass(frozen=True)
class View:
    """How places are perceived: in which unit and axes, and how exactly.

    Attributes:
        noise: standard deviation of the error of each coordinate at each step [m], also of what is
            learned from.
        units: per metre: 1000 for percepts in millimetres.
        turn: angle by which the axes of perception are turned about z [degrees]. Actions stay in
            the robot's own axes.
    """

    noise: float = 0.0
    units: float = 1.0
    turn: float = 0.0

    def __str__(self) -> str:
        """Return what differs from the usual view, for names of files and rows; '' for nothing."""
        usual, own = View(), vars(self)
        parts = [f"{name} {own[name]:g}" for name in own if own[name] != getattr(usual, name)]
        return ", ".join(parts)

    def see(
        self, percepts: Array, random: np.random.Generator | None = None
    ) -> NDArray[np.float32]:
        """Return percepts `[..., D]` as they are perceived; without a generator, exactly."""
        places = places_of(percepts).astype(np.float64)
        if random is not None and self.noise:
            places = places + random.normal(0, self.noise, places.shape)
        places = (places @ self._axes().T * self.units).reshape(*percepts.shape[:-1], -1)
        return np.insert(places, GRIPPER, percepts[..., GRIPPER], axis=-1).astype(np.float32)

    def seen(self, demonstrations: Demonstrations) -> Demonstrations:
        """Return demonstrations as they are perceived."""
        episodes, random = [], np.random.default_rng(len(demonstrations))
        for shown in demonstrations:
            percepts = torch.from_numpy(self.see(shown.percepts.numpy(), random))
            state, surroundings = percepts[:, : len(STATE)], percepts[:, len(STATE) :]
            episodes.append(replace(shown, state=state, environment_state=surroundings))
        return replace(demonstrations, episodes=tuple(episodes))

    def _axes(self) -> Array:
        """Return the matrix from the robot's axes to those of perception."""
        angle = np.radians(self.turn)
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
