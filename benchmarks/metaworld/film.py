"""A film of one task that was shown once: `python -m benchmarks.metaworld.film TASK`.

On the left the demonstration, again and again; on the right a learner in other places, the first of
those that are evaluated, whether it succeeds or not. It needs OpenGL; Debian has it without a
display in libegl1 and libgl1-mesa-dri.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from benchmarks.metaworld import evaluation, recording
from benchmarks.metaworld.features import Array, View
from benchmarks.metaworld.learners import LEARNERS, TITLES
from benchmarks.metaworld.report import FILM
from benchmarks.metaworld.simulation import FPS, HORIZON, World, is_installed

PLACES = 4  # in which the learner is shown
SIDE = 200  # of a picture [pixels]
LOOK_AT = (0.0, 0.68, 0.12)  # above the middle of the table [m]
DISTANCE = 1.15  # of the camera [m]
AZIMUTH, ELEVATION = 145, -28  # of its view [degrees]
EVERY = 5  # frames
SLOWER = 2  # than in reality
PAUSE = 8  # pictures at the end of each episode
COLOURS = 128

Picture = NDArray[np.uint8]  # [SIDE, SIDE, 3]


class Filmed:
    """A world that takes a picture before every few steps, and of the last frame."""

    def __init__(self, world: World) -> None:
        import mujoco

        self.world = world
        made: Any = mujoco
        self._renderer = made.Renderer(world.env.model, SIDE, SIDE)
        self._camera = made.MjvCamera()
        self._camera.lookat[:] = LOOK_AT
        self._camera.distance = DISTANCE
        self._camera.azimuth, self._camera.elevation = AZIMUTH, ELEVATION
        self.pictures: list[Picture] = []
        self._steps = 0

    def reset(self, seed: int) -> Array:
        """Start an episode and its film."""
        observation = self.world.reset(seed)
        self.pictures, self._steps = [], 0
        self._take()
        return observation

    def step(self, action: Array) -> tuple[Array, bool]:
        """Take a step."""
        observation, success = self.world.step(action)
        self._steps += 1
        if success or self._steps % EVERY == 0:
            self._take()
        return observation, success

    def close(self) -> None:
        """Give OpenGL's memory back, while there still is an OpenGL."""
        self._renderer.close()

    def _take(self) -> None:
        """Take a picture."""
        self._renderer.update_scene(self.world.env.data, camera=self._camera)
        self.pictures.append(self._renderer.render().copy())


def film(task: str, name: str) -> list[Image.Image]:
    """Return the pictures of a film.

    Args:
        task: which is shown once.
        name: of the learner.
    """
    world = World(task)
    with tempfile.TemporaryDirectory() as folder:
        dataset = recording.demonstrations_of(world, 0, Path(folder))
        learner = LEARNERS[name]()
        learner.learn(recording.load(dataset, 1))
    # After learning: what torch imports for it must be loaded before OpenGL's software renderer.
    filmed, pictures = Filmed(world), []
    shown = _pictures_of_demonstration(filmed)
    for place in range(PLACES):
        outcome = evaluation.run(filmed, learner, evaluation.SEEDS + place, View())
        print(f"{task}, place {place + 1}: {'success' if outcome.success else 'failure'}")
        words = f"{TITLES[name].strip('`')}, place {place + 1} of {PLACES}"
        pictures += _side_by_side(shown, filmed.pictures, words)
    filmed.close()
    return pictures


def _pictures_of_demonstration(filmed: Filmed) -> list[Picture]:
    """Return the pictures of the first demonstration of draw 0, until it succeeds."""
    seed = recording.SEEDS
    while (shown := recording.demonstrate(filmed.world, seed)) is None:
        seed += 1
    filmed.reset(seed)
    for action in shown.actions[: HORIZON - recording.AFTER]:
        if filmed.step(action)[1]:
            break
    return filmed.pictures


def _side_by_side(left: list[Picture], right: list[Picture], words: str) -> Iterator[Image.Image]:
    """Yield pictures of both until both are over, and a pause."""
    for frame in range(max(len(left), len(right)) + PAUSE):
        both = [side[min(frame, len(side) - 1)] for side in (left, right)]
        picture = Image.fromarray(np.concatenate(both, axis=1))
        draw = ImageDraw.Draw(picture)
        for at, text in ((6, "shown once"), (SIDE + 6, words)):
            draw.text((at, 4), text, "white", stroke_width=2, stroke_fill="black")
        yield picture


def write(pictures: list[Image.Image], path: Path) -> None:
    """Write pictures as a film, with the same colours in all of them."""
    palette = pictures[len(pictures) // 2].quantize(COLOURS)
    reduced = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures]
    milliseconds = round(1000 * SLOWER * EVERY / FPS)
    reduced[0].save(
        path, save_all=True, append_images=reduced[1:], duration=milliseconds, loop=0, optimize=True
    )


def main() -> None:
    """Film one task."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.metaworld.film",
        description="Film a learner of one demonstration, in places that it was not shown.",
    )
    parser.add_argument("task", help="name of the task")
    parser.add_argument("--learner", choices=LEARNERS, default="pacnet", help="(pacnet)")
    parser.add_argument("--out", type=Path, default=FILM, help="(docs/images/metaworld.gif)")
    arguments = parser.parse_args()
    if not is_installed():
        sys.exit("expected Metaworld to be installed: `make metaworld` does it, in .venv-metaworld")
    os.environ.setdefault("MUJOCO_GL", "egl")
    write(film(arguments.task, arguments.learner), arguments.out)
    print(f"wrote {arguments.out}, {arguments.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
