"""What drives a robot alone: the default behaviour, the teacher's controller, a trained network."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from envs.khepera import MAX_WHEEL_SPEED
from envs.wall_behaviours import Side, WallFollower, Wanderer
from pacnet import NO_NODE, PACNet


class Driven(NamedTuple):
    """What drove the robot in one step."""

    action: NDArray[np.float32]  # [2] shares of the wheels' largest speed
    winner: int = NO_NODE  # node that won the percept
    commanded: bool = False  # by the network, not by the default behaviour


class Driver(Protocol):
    """Drives the robot alone."""

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        ...


class Wandering:
    """Drive by the default behaviour alone.

    Args:
        seed: Of its turns.
    """

    def __init__(self, seed: int) -> None:
        self._wanderer = Wanderer(np.random.default_rng(seed))

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        return Driven(shares(self._wanderer.act(percept)))


class Teacher:
    """Drive the learner's body by the teacher's controller.

    Args:
        side: Of the wall.
    """

    def __init__(self, side: Side) -> None:
        self._follower = WallFollower(side)

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        return Driven(shares(self._follower.act(percept)))


class Recalling:
    """Drive by a trained network; without an action, wander.

    Args:
        network: With a forward model.
        seed: Of the wandering.
    """

    def __init__(self, network: PACNet, seed: int) -> None:
        network.reset()
        self._network = network
        self._wanderer = Wanderer(np.random.default_rng(seed))

    def drive(self, percept: NDArray[np.float32]) -> Driven:
        """Return what to do on a percept `[6]`."""
        decision = self._network.step(percept)
        winner = NO_NODE if decision.is_novel else decision.winner
        if decision.action is not None:
            self._wanderer.take_over(MAX_WHEEL_SPEED * decision.action)
            return Driven(decision.action, winner, commanded=True)
        return Driven(shares(self._wanderer.act(percept)), winner)


def shares(wheels: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return wheel speeds [m/s] as an action `[2]` of the environment, within its limits."""
    return np.clip(wheels / MAX_WHEEL_SPEED, -1, 1).astype(np.float32)
