"""A film of the imitator alone: the glass stands elsewhere, nobody shows anything, it drinks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from train.postural.alone.actors import make_actor
from train.postural.alone.episodes import act
from train.postural.alone.scenes import ALONE, OURS, SCENES
from train.postural.episodes import FPS, Condition, make_environment
from train.postural.report import NAMES, with_names, write_film

FRAME_STEPS = 5  # steps from one frame to the next
FILMED_STEPS = 600  # [steps] of the episode; it rests after that


def film(folder: Path, seed: int) -> None:
    """Write `alone.mp4` and `alone.gif` of an episode within 15 cm into a run's folder."""
    environment = make_environment(Condition(), render=True)
    frames: list[NDArray[np.uint8]] = []
    with tqdm(total=FILMED_STEPS, desc="filming alone", unit="step") as progress:

        def take(step: int) -> None:
            if step > FILMED_STEPS:
                return
            progress.update()
            if step % FRAME_STEPS == 0:
                frames.append(with_names(environment.render(), NAMES[1:]))

        act(make_actor(OURS, folder), environment, SCENES[ALONE], seed, take)
    write_film(frames, folder / "alone", FPS / FRAME_STEPS)
