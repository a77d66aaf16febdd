"""A dataset for the tests of points: a hand that picks an object up and carries it to a goal."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from command_line import ACTION, STATE, SURROUNDINGS
from numpy.typing import NDArray

from pacnet.datasets.recorder import Recorder

NAMES = {
    STATE: ("hand.x", "hand.y", "gripper"),
    SURROUNDINGS: ("object.x", "object.y", "goal.x", "goal.y"),
    ACTION: ("vx", "vy", "close"),
}
FPS = 50
LEG, REST = 40, 6  # [frames] of a movement, and of a rest after it


def _leg(begin: NDArray, end: NDArray) -> NDArray[np.float64]:
    """A steady movement and a rest, `[LEG + REST, 2]`."""
    moved = begin + (end - begin) * np.linspace(0, 1, LEG)[:, None]
    return np.concatenate([moved, np.tile(end, (REST, 1))])


def record_carrying(root: Path, astray: Sequence[bool], seed: int = 0, task: str = "carry") -> Path:
    """An episode for each flag: to the object, then to the goal; astray to the goal before."""
    rng = np.random.default_rng(seed)
    with Recorder(root, FPS, NAMES, "hand") as recorder:
        for strays in astray:
            shifts = rng.uniform(-0.1, 0.1, (3, 2))
            start, thing, goal = shifts + np.array([[0, 0], [0.5, 0], [0.5, 0.6]])
            ways = [(start, goal), (goal, thing)] if strays else [(start, thing)]
            legs = [_leg(*way) for way in ways]
            last = _leg(thing, goal)[:LEG]  # it ends where it arrives
            places = np.concatenate([*legs, last])
            grip = np.r_[np.zeros(len(places) - LEG), np.ones(LEG)][:, None]
            around = np.concatenate([np.tile(thing, (len(places) - LEG, 1)), last])
            moves = FPS * np.diff(places, axis=0, append=places[-1:])
            recorder.save_episode(
                task,
                {
                    STATE: np.concatenate([places, grip], axis=1),
                    SURROUNDINGS: np.concatenate([around, np.tile(goal, (len(grip), 1))], axis=1),
                    ACTION: np.concatenate([moves, grip], axis=1),
                },
            )
    return root
