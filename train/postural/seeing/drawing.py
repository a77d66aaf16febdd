"""What is drawn: a picture that was not shown, beside the remembered one; and a film of a drink."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from tqdm import tqdm

from pacnet import Imitator
from pacnet.evaluation.figure_style import new_figure
from train.postural.alone.episodes import act
from train.postural.alone.film import FILMED_STEPS, FRAME_STEPS
from train.postural.episodes import FPS, Condition, make_environment
from train.postural.report import NAMES, with_names, write_film
from train.postural.seeing.actors import Seeing
from train.postural.seeing.trials import STANDING, demonstrations_of
from train.postural.seeing.watching import CAMERA

Boxes = Sequence[tuple[float, float, float, float]]
"""Left, top, right and bottom of each [pixels]."""
_BOX = (0, 158, 115)  # green
_INSET = 160  # [pixels] side of the camera's picture in a film


def beside_the_remembered(place: Path, checkpoint: Path, count: int, seed: int) -> Figure:
    """Draw an unseen first picture, and that of the demonstration which is followed most.

    Args:
        place: Of the replicate, which holds its dataset.
        checkpoint: Of an imitator that looks.
        count: Number of demonstrations from which it learned.
        seed: Of the episode.
    """
    imitator = Imitator.from_pretrained(checkpoint).eval()
    environment = make_environment(Condition())
    observation, _ = environment.reset(seed=seed, options=STANDING.options(seed))
    seen = environment.look()
    environment.close()
    followed = imitator.step(observation["proprioception"], {CAMERA: seen}).followed
    number = max(followed, key=lambda one: one.weight).demonstration if followed else 0
    shown = demonstrations_of(place, count).episodes[number]
    remembered = shown.pictures[CAMERA][0]
    figure = new_figure(6.4, 3.5)
    grid = figure.subplots(1, 2)
    titles = ("What it sees", f"What it remembers: demonstration {number + 1}")
    for axes, title, picture in zip(grid, titles, (seen, remembered), strict=True):
        axes.imshow(_enlarged(picture, _boxes(imitator, picture)))
        axes.set_title(title, fontsize=11, loc="left")
        axes.set_axis_off()
    return figure


def film(checkpoint: Path, seed: int, path: Path) -> None:
    """Write `path.mp4` and `path.gif` of an episode, in a corner what the camera sees.

    Args:
        checkpoint: Of an imitator that looks.
        seed: Of the episode.
        path: Without an ending.
    """
    environment = make_environment(Condition(), render=True)
    actor = Seeing(Imitator.from_pretrained(checkpoint).eval(), environment)
    frames: list[NDArray[np.uint8]] = []
    with tqdm(total=FILMED_STEPS, desc="filming", unit="step") as progress:

        def take(step: int) -> None:
            if step > FILMED_STEPS:
                return
            progress.update()
            if step % FRAME_STEPS == 0:
                seen = environment.look()  # boxes are there as long as it looks
                boxes = _boxes(actor.imitator, seen) if actor.imitator.is_looking else ()
                boxed = _enlarged(seen, boxes)
                frames.append(_with_inset(with_names(environment.render(), NAMES[1:]), boxed))

        act(actor, environment, STANDING, seed, take)
    environment.close()
    write_film(frames, path, FPS / FRAME_STEPS)


def _boxes(imitator: Imitator, picture: NDArray[np.uint8]) -> Boxes:
    """Return the boxes of what is attended to in a picture."""
    assert imitator.cameras is not None
    return imitator.cameras.encoders[CAMERA].look(torch.tensor(picture)).boxes


def _enlarged(picture: NDArray[np.uint8], boxes: Boxes) -> NDArray[np.uint8]:
    """Return a picture, enlarged, with boxes."""
    factor = _INSET * 2 / len(picture)
    drawn = Image.fromarray(picture).resize((2 * _INSET, 2 * _INSET), Image.Resampling.NEAREST)
    for left, top, right, bottom in boxes:
        corners = (factor * left, factor * top, factor * right, factor * bottom)
        ImageDraw.Draw(drawn).rectangle(corners, outline=_BOX, width=4)
    return np.asarray(drawn)


def _with_inset(frame: NDArray[np.uint8], inset: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a frame with a picture in its upper left corner, at a size of `_INSET`."""
    small = Image.fromarray(inset).resize((_INSET, _INSET), Image.Resampling.BOX)
    whole = Image.fromarray(frame)
    whole.paste(small, (8, 8))
    return np.asarray(whole)
