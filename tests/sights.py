"""A toy arm that goes to a bright square, seen by a camera: what tests of pictures need."""

from pathlib import Path

import numpy as np
import torch

from pacnet.datasets.demonstrations import Demonstration, Demonstrations

TOP = "observation.images.top"
NAMES = {"observation.state": ("hand.x", "hand.y"), "action": ("dx", "dy")}
FPS, FRAMES = 20, 40  # [1/s], frames
HEIGHT, WIDTH = 96, 112  # [pixels]


def picture(goal: np.ndarray, hand: np.ndarray, seen: bool = True) -> np.ndarray:
    """A square with a dark bar at the goal, and the hand's dot above, on a floor with structure."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    image = np.stack([90 + rows, 70 + columns, 80 + (rows + columns) // 3], 2).astype(np.uint8)
    row, column = pixel_of(goal)
    if seen:
        image[row - 6 : row + 7, column - 6 : column + 7] = (250, 220, 40)
        image[row - 2 : row + 3, column - 4 : column + 3] = (20, 20, 120)
    row, column = pixel_of(hand).clip(11, HEIGHT - 3)
    image[row - 11 : row - 8, column - 2 : column + 2] = (200, 30, 30)
    return image


def pixel_of(place: np.ndarray) -> np.ndarray:
    """The row and column of a place."""
    return (18 + 60 * place).round().astype(int)


def episode(number: int, goal: np.ndarray, seen: bool = True) -> Demonstration:
    """From the corner to the goal, which the picture alone shows."""
    along = np.linspace(0, 1, FRAMES)[:, None]
    hand = (np.array([-0.15, -0.15]) + along * (goal - (-0.15))).astype(np.float32)
    action = np.gradient(hand, axis=0).astype(np.float32)
    pictures = np.stack([picture(goal, one, seen) for one in hand])
    return Demonstration(
        number,
        "reach",
        torch.from_numpy(hand),
        torch.empty(FRAMES, 0),
        torch.from_numpy(action),
        pictures={TOP: pictures},
    )


def demonstrations(count: int, seed: int = 0, seen: bool = True) -> Demonstrations:
    """Episodes with goals anywhere within a unit square."""
    goals = np.random.default_rng(seed).uniform(0, 1, (count, 2))
    return Demonstrations(
        FPS, NAMES, tuple(episode(number, goal, seen) for number, goal in enumerate(goals)), "toy"
    )


def write(root: Path, shown: Demonstrations, with_pictures: bool = True) -> Path:
    """A dataset of demonstrations, as `Recorder` writes it."""
    from pacnet.datasets.recorder import Picture, Recorder

    sizes = {name: one.shape[1:3] for name, one in shown.episodes[0].pictures.items()}
    cameras = {name: Picture(*size) for name, size in sizes.items() if with_pictures}
    with Recorder(root, FPS, {**NAMES, **cameras}, "toy") as recorder:
        for one in shown:
            rows = {"observation.state": one.state.numpy(), "action": one.action.numpy()}
            recorder.save_episode(one.task, rows | {name: one.pictures[name] for name in cameras})
    return root
