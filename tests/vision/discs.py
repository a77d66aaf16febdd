"""What the tests of cameras show: a hand that goes to a disc, on a table with a texture.

Places are in metres, x to the right and y away from the camera, both from 0 to 1.
"""

from __future__ import annotations

import functools

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from pacnet.datasets.demonstrations import Demonstration, Demonstrations

Picture = NDArray[np.uint8]

TOP, SIDE = "observation.images.top", "observation.images.side"
FPS = 20
HEIGHT, WIDTH = 48, 64
RADIUS = 3.5  # pixels
RED, DARK = (220, 40, 40), (25, 25, 35)  # of the disc, and of the hand
START = np.array([0.5, 0.05])  # of the hand
FASTEST = 0.8  # [m/s]
NAMES = {"observation.state": ("hand.x", "hand.y"), "action": ("hand.x", "hand.y")}


@functools.cache
def table(height: int = HEIGHT, width: int = WIDTH, seed: int = 0) -> NDArray[np.float32]:
    """A ground with blots of some pixels, in grey and brown."""
    generator = torch.Generator().manual_seed(seed)
    coarse = torch.rand(1, 3, height // 6, width // 6, generator=generator)
    smooth = functional.interpolate(coarse, (height, width), mode="bicubic")[0]
    return (90 + 60 * smooth).clamp(0, 255).permute(1, 2, 0).numpy()


def pixel(place: NDArray[np.floating], height: int = HEIGHT, width: int = WIDTH) -> tuple:
    """Where a place is seen: column and row of it [pixels]."""
    return 6 + (width - 12) * place[0], height - 6 - (height - 12) * place[1]


def draw_disc(picture: NDArray[np.floating], place, colour=RED, radius: float = RADIUS) -> None:
    """Paint a disc with soft edges into a picture."""
    height, width = picture.shape[:2]
    column, row = pixel(place, height, width)
    rows, columns = np.mgrid[:height, :width]
    inside = np.clip(radius + 0.5 - np.hypot(rows - row, columns - column), 0, 1)[..., None]
    picture[:] = (1 - inside) * picture + inside * np.array(colour)


def picture_of(disc=None, hand=START, *, noise: float = 2.0, seed: int = 0) -> Picture:
    """A picture of the table with the hand and a disc, which it hides, or without a disc."""
    picture = table().astype(np.float64)
    if disc is not None:
        draw_disc(picture, disc)
    if hand is not None:
        draw_disc(picture, hand, DARK)
    grain = np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.clip(picture + grain, 0, 255).astype(np.uint8)


def places(count: int, seed: int) -> NDArray[np.float64]:
    """Places of the disc, away from where the hand begins."""
    return np.random.default_rng(seed).uniform((0.05, 0.35), (0.95, 0.95), (count, 2))


def path_to(goal: NDArray[np.floating]) -> NDArray[np.float32]:
    """Where the hand is in each frame: it goes there at one speed, and rests for half a second."""
    way = goal - START
    frames = max(2, round(float(np.linalg.norm(way)) / FASTEST * FPS))
    share = np.concatenate([np.linspace(0, 1, frames), np.ones(FPS // 2)])
    return (START + share[:, None] * way).astype(np.float32)


def film(disc: NDArray[np.floating], path: NDArray[np.floating], seed: int) -> Picture:
    """What the camera sees while the hand moves, `[T, H, W, 3]`."""
    return np.stack([picture_of(disc, at, seed=1000 * seed + n) for n, at in enumerate(path)])


def demonstrate(
    disc: NDArray[np.floating], episode: int = 0, cameras: tuple[str, ...] = (TOP,)
) -> Demonstration:
    """The hand goes to the disc, which stays; its action is the place to be at next.

    The camera at the side sees the table alone.
    """
    path = path_to(disc)
    seen = {TOP: film(disc, path, episode)}
    seen[SIDE] = np.stack([picture_of(None, None, seed=n) for n in range(len(path))])
    state, nothing = torch.from_numpy(path), torch.empty(len(path), 0)
    action = torch.cat([state[1:], state[-1:]])
    pictures = {camera: seen[camera] for camera in cameras}
    return Demonstration(episode, "go there", state, nothing, action, pictures=pictures)


def shown(*episodes: Demonstration) -> Demonstrations:
    return Demonstrations(FPS, NAMES, episodes, "discs")


def demonstrations(count: int, seed: int = 0, cameras: tuple[str, ...] = (TOP,)) -> Demonstrations:
    """Demonstrations with the disc elsewhere each time."""
    where = enumerate(places(count, seed))
    return shown(*(demonstrate(disc, number, cameras) for number, disc in where))


def hands_of(demonstrations: Demonstrations) -> list[NDArray[np.float32]]:
    return [shown.state.numpy() for shown in demonstrations]
