"""Who acts in a scene: each turns an observation into joint-angle targets, or holds the last."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from envs.behaviours import REST_POSTURE
from envs.humanoid import JOINTS
from envs.postural_imitation import percept
from pacnet import PACNet
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator.imitator import Imitator
from train.postural.alone.learning import FOLDERS
from train.postural.alone.scenes import (
    COPYING,
    NEAREST,
    OURS,
    OURS_ONE,
    PACNET,
    REPLAY,
    UNFRAMED,
)

Observation = dict[str, NDArray[np.float32]]
Target = NDArray[np.float32] | NDArray[np.float64] | None  # [11] [rad]; None to hold the last one
Shown = tuple[list[NDArray[np.float32]], list[NDArray[np.float32]]]  # percepts, actions [T, D]

# The exponential filter of a copying arm: its rate, and the lag [s] that it makes up for.
COPYING_RATE, COPYING_LEAD = 0.3, 0.067


class Actor(Protocol):
    """Acts in one episode after the other."""

    is_novel: bool  # whether the last observation was unlike what was shown

    def reset(self) -> None:
        """Start an episode."""
        ...

    def step(self, observation: Observation) -> Target:
        """Return the target of the coming step."""
        ...


def own_percept(observation: Observation) -> NDArray[np.float32]:
    """Return the own body and glass, in the 28 dimensions in which `percept` has the other's."""
    return np.concatenate([observation["proprioception"], observation["own_glass"]])


class Alone:
    """An imitator that perceives itself and its own glass.

    Args:
        imitator: In eval mode.
        task: That it is asked for, or None for whatever fits.
    """

    def __init__(self, imitator: Imitator, task: str | None = None) -> None:
        self._imitator, self._task, self.is_novel = imitator, task, False

    def reset(self) -> None:
        """Start an episode."""
        self._imitator.reset(self._task)

    def step(self, observation: Observation) -> Target:
        """Return the target of the coming step."""
        step = self._imitator.step(own_percept(observation))
        self.is_novel = step.is_novel
        return step.action


class _Watching:
    """The paper's network, which perceives the demonstrator and its glass."""

    def __init__(self, network: PACNet) -> None:
        self._network, self.is_novel = network, False

    def reset(self) -> None:
        self._network.reset()

    def step(self, observation: Observation) -> Target:
        decision = self._network.step(percept(observation))
        self.is_novel = decision.is_novel
        return decision.target


class _Copying:
    """A filter of the demonstrator's angles, y += 0.3 (angles + 0.067 s velocities − y)."""

    is_novel = False

    def reset(self) -> None:
        self._target = REST_POSTURE.copy()

    def step(self, observation: Observation) -> Target:
        angles, velocities = np.split(observation["demonstrator"], [len(JOINTS)])
        if not angles.any():  # nobody is perceived
            return None
        self._target += COPYING_RATE * (angles + COPYING_LEAD * velocities - self._target)
        return self._target


class _Replay:
    """The actions of the demonstration whose first percept is nearest, in their order."""

    is_novel = False

    def __init__(self, shown: Shown, scale: NDArray[np.float32]) -> None:
        percepts, self._actions = shown
        self._firsts, self._scale = np.stack([seen[0] for seen in percepts]) * scale, scale

    def reset(self) -> None:
        self._played: NDArray[np.float32] | None = None
        self._step = -1

    def step(self, observation: Observation) -> Target:
        if self._played is None:
            self._played = self._actions[_nearest(self._firsts, self._scale, observation)]
        self._step = min(self._step + 1, len(self._played) - 1)
        return self._played[self._step]


class _Nearest:
    """The action of the frame whose percept is nearest, of all demonstrations."""

    is_novel = False

    def __init__(self, shown: Shown, scale: NDArray[np.float32]) -> None:
        percepts, actions = shown
        self._percepts, self._scale = np.concatenate(percepts) * scale, scale
        self._actions = np.concatenate(actions)

    def reset(self) -> None:
        """Do nothing: it has no memory."""

    def step(self, observation: Observation) -> Target:
        return self._actions[_nearest(self._percepts, self._scale, observation)]


def make_actor(row: str, folder: Path) -> Actor:
    """Return who acts in a row, as it was learned in a run's folder and saved there."""
    if row in (OURS, OURS_ONE, UNFRAMED):
        return Alone(Imitator.from_pretrained(folder / FOLDERS[row]).eval())
    makers: dict[str, Callable[[], Actor]] = {
        PACNET: lambda: _Watching(PACNet.from_pretrained(folder / "checkpoint").eval()),
        COPYING: _Copying,
        REPLAY: lambda: _Replay(*_shown(folder)),
        NEAREST: lambda: _Nearest(*_shown(folder)),
    }
    return makers[row]()


def _shown(folder: Path) -> tuple[Shown, NDArray[np.float32]]:
    """Return what the dataset shows, and the scale that the imitator chose for its percepts."""
    episodes = load_demonstrations(folder / "dataset").episodes
    scale = Imitator.from_pretrained(folder / FOLDERS[OURS]).config.scaling.array
    percepts = [shown.percepts.numpy() for shown in episodes]
    return (percepts, [shown.action.numpy() for shown in episodes]), scale


def _nearest(
    frames: NDArray[np.float32], scale: NDArray[np.float32], observation: Observation
) -> int:
    """Return the row of the scaled frames `[N, 28]` that is nearest to the own percept."""
    apart = frames - own_percept(observation) * scale
    return int(np.einsum("ij,ij->i", apart, apart).argmin())
