"""Who acts on pictures: each has the camera beside its own head, and is not told of the glass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from envs.head_camera import SIZE
from envs.postural_imitation import PosturalImitationEnv
from pacnet import Imitator
from pacnet.datasets.demonstrations import Demonstration
from train.postural.alone.actors import Observation, Target
from train.postural.learning import SCALE
from train.postural.seeing.watching import CAMERA

_GRID = 16  # [cells] along each side, to which a picture is averaged where pictures are compared


class Seeing:
    """An imitator that perceives its own angles and velocities, and what its camera sees.

    Args:
        imitator: In eval mode; one that learned without pictures looks at none.
        environment: In which it acts.
    """

    def __init__(self, imitator: Imitator, environment: PosturalImitationEnv) -> None:
        self.imitator, self.is_novel = imitator, False
        self._environment = environment

    def reset(self) -> None:
        """Start an episode."""
        self.imitator.reset()

    def step(self, observation: Observation) -> Target:
        """Return the target of the coming step."""
        pictures = {CAMERA: self._environment.look()} if self.imitator.is_looking else None
        step = self.imitator.step(observation["proprioception"], pictures)
        self.is_novel = step.is_novel
        return step.action


class Replay:
    """The actions of the demonstration whose first picture is nearest, in their order.

    Args:
        shown: With pictures.
        environment: In which it acts.
    """

    is_novel = False

    def __init__(self, shown: Sequence[Demonstration], environment: PosturalImitationEnv) -> None:
        self._firsts = np.stack([coarse(one.pictures[CAMERA][0]) for one in shown])
        self._actions = [one.action.numpy() for one in shown]
        self._environment = environment

    def reset(self) -> None:
        """Start an episode; the choice is made at its first step."""
        self._played: NDArray[np.float32] | None = None
        self._step = -1

    def step(self, observation: Observation) -> Target:  # noqa: ARG002  an Actor's
        """Return the target of the coming step."""
        if self._played is None:
            apart = _distances(self._firsts, coarse(self._environment.look()))
            self._played = self._actions[int(apart.argmin())]
        self._step = min(self._step + 1, len(self._played) - 1)
        return self._played[self._step]


class Nearest:
    """The action of the frame whose state and first picture are nearest, of all demonstrations.

    Squared distances of first pictures count as much, on average, as those of states.

    Args:
        shown: With pictures.
        environment: In which it acts.
    """

    is_novel = False

    def __init__(self, shown: Sequence[Demonstration], environment: PosturalImitationEnv) -> None:
        states = np.concatenate([one.state.numpy() for one in shown])
        self._scale = np.array(SCALE[: states.shape[1]], np.float32)
        self._states = states * self._scale
        self._firsts = np.stack([coarse(one.pictures[CAMERA][0]) for one in shown])
        spread = max(float(self._firsts.var(axis=0).sum()), 1e-9)
        self._weight = float(self._states.var(axis=0).sum()) / spread
        self._frames = [len(one.state) for one in shown]
        self._actions = np.concatenate([one.action.numpy() for one in shown])
        self._environment = environment

    def reset(self) -> None:
        """Start an episode; it looks at its first step."""
        self._off: NDArray[np.float32] | None = None  # of each frame's first picture

    def step(self, observation: Observation) -> Target:
        """Return the target of the coming step."""
        if self._off is None:
            off = self._weight * _distances(self._firsts, coarse(self._environment.look()))
            self._off = np.repeat(off, self._frames)
        apart = _distances(self._states, observation["proprioception"] * self._scale)
        return self._actions[int((apart + self._off).argmin())]


def coarse(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return a picture `[128, 128, 3]` averaged over 16 × 16 cells, as a row from 0 to 1."""
    cell = SIZE // _GRID
    cells = picture.reshape(_GRID, cell, _GRID, cell, 3).mean(axis=(1, 3), dtype=np.float32)
    return cells.ravel() / 255


def _distances(rows: NDArray[np.float32], row: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return squared distances `[N]` of rows `[N, D]` from one `[D]`."""
    apart = rows - row
    return np.einsum("ij,ij->i", apart, apart)
