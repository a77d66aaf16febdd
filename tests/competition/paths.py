"""What the tests of following show: a point that moves along paths, and a robot that is one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator, ImitatorStep

FPS = 50
PLACES = {"observation.state": ("x", "y"), "action": ("x", "y")}
SPEEDS = {"observation.state": ("x", "y"), "action": ("vx", "vy")}
Path = NDArray[np.float64]  # [T, 2], one place a frame


def line(begin: tuple[float, float], end: tuple[float, float], seconds: float = 2.0) -> Path:
    """Straight on, at one speed; recorded at `FPS`."""
    return np.linspace(begin, end, round(seconds * FPS))


def bend(seconds: float = 2.0, fps: float = FPS) -> Path:
    """A bow from (0, 0) over (1, 1) to (2, 0)."""
    share = np.linspace(0, 1, round(seconds * fps))
    return np.stack([2 * share, np.sin(math.pi * share)], axis=1)


def shown(*paths: Path, tasks: tuple[str, ...] = (), fps: float = FPS) -> Demonstrations:
    """Demonstrations whose action is the place one frame later."""
    tasks = tasks or ("go",) * len(paths)
    episodes = []
    for number, (path, task) in enumerate(zip(paths, tasks, strict=True)):
        state, nothing = torch.from_numpy(path).float(), torch.empty(len(path), 0)
        after = torch.cat([state[1:], state[-1:]])
        episodes.append(Demonstration(number, task, state, nothing, after))
    return Demonstrations(fps, PLACES, tuple(episodes), "paths")


def shown_by_speed(*paths: Path) -> Demonstrations:
    """Demonstrations whose action is a speed [1/s]."""
    episodes = []
    for number, path in enumerate(paths):
        state, nothing = torch.from_numpy(path).float(), torch.empty(len(path), 0)
        ahead = torch.cat([state[1:], 2 * state[-1:] - state[-2:-1]])
        episodes.append(Demonstration(number, "go", state, nothing, FPS * (ahead - state)))
    return Demonstrations(FPS, SPEEDS, tuple(episodes), "paths")


def learned(demonstrations: Demonstrations) -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return imitator


class Run(NamedTuple):
    """What a robot did in T frames."""

    places: Path  # [T + 1, 2], where it was, and where it is then
    steps: list[ImitatorStep]  # T of them

    @property
    def frames(self) -> list[int]:
        """The moment of the demonstration with the largest weight, at each step."""
        return [step.followed[0].frame for step in self.steps]


def run(
    imitator: Imitator,
    start: object,
    frames: int,
    blocked: range = range(0),
    pushes: Mapping[int, tuple[float, float]] | None = None,
    task: str | None = None,
    by_speed: bool = False,
) -> Run:
    """Let a robot act that is at each frame where the last action sent it.

    Args:
        imitator: decides.
        start: where the robot is at first.
        frames: how many.
        blocked: frames in which the robot cannot move.
        pushes: what moves the robot before a frame.
        task: what is to be done.
        by_speed: whether actions are speeds.
    """
    imitator.reset(task)
    place, places, steps = np.array(start, np.float64), [], []
    for frame in range(frames):
        place = place + (pushes or {}).get(frame, (0.0, 0.0))
        places.append(place)
        step = imitator.step(place.astype(np.float32))
        steps.append(step)
        if step.action is not None and frame not in blocked:
            place = place + step.action / FPS if by_speed else step.action.astype(np.float64)
    return Run(np.array([*places, place]), steps)
