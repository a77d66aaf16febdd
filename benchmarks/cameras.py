"""The time to fit an imitator that sees, and of its steps: `python -m benchmarks.cameras`.

Pictures are drawn: a textured table, a box in another place each time, an arm that goes to it.
"""

from __future__ import annotations

import time

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.harness import NOTHING, Table, latencies, number, run_alone
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.datasets.pictures import reduce
from pacnet.imitator.imitator import Imitator

WIDTH, HEIGHT = 640, 480  # [pixels]
CAMERAS = {"observation.images.top": (1.0, 0.2), "observation.images.side": (-0.3, 0.9)}
"""Camera -> how far along a row [half widths] one metre to the right and one ahead are seen."""
SHOWN, LENGTH, FPS = 20, 100, 30
BOX, ARM = 40, 30  # sides of the box and of the arm [pixels]
STEPS = 300
FIT_WANTED, STEP_WANTED = 10, 20  # [s], [ms]
TEXT = f"""An imitator that sees learns {SHOWN} demonstrations of {LENGTH} frames at {FPS} Hz of a
hand that goes to a box, by two cameras of {WIDTH} × {HEIGHT} pixels; the pictures are reduced
before, as decoding does. It chooses its encoders by itself. Then it acts in {STEPS} frames of
episodes that it has not seen, with pictures of {WIDTH} × {HEIGHT} pixels; a step is the call of
`Imitator.step` with both. One thread. All kernels were compiled before.
"""

Picture = NDArray[np.uint8]  # [HEIGHT, WIDTH, 3]


def tables_of(random: np.random.Generator) -> dict[str, Picture]:
    """Return the table as each camera sees it, without arm and box."""
    coarse = random.uniform(60, 160, (len(CAMERAS), HEIGHT // 20, WIDTH // 20, 3))
    fine = np.kron(coarse, np.ones((1, 20, 20, 1))) + random.normal(0, 6, (HEIGHT, WIDTH, 3))
    return dict(zip(CAMERAS, np.clip(fine, 0, 255).astype(np.uint8), strict=True))


def drawn(
    table: Picture, camera: str, hand: NDArray[np.floating], box: NDArray[np.floating]
) -> Picture:
    """Return what a camera sees of a hand and a box, whose places are within ±0.4 m."""
    picture = table.copy()
    _square(picture, _pixel(camera, box), BOX, (200, 40, 40))
    _square(picture, _pixel(camera, box), BOX // 2, (240, 220, 40))
    row, column = _pixel(camera, hand)
    picture[: max(row, 0), max(column - ARM // 2, 0) : column + ARM // 2] = (40, 60, 200)
    return picture


def _pixel(camera: str, place: NDArray[np.floating]) -> tuple[int, int]:
    """Return the row and column of a place `[2]`."""
    right, ahead = CAMERAS[camera]
    across = right * place[0] + ahead * place[1]
    along = right * place[1] - ahead * place[0]
    return int(HEIGHT / 2 * (1 + along)), int(WIDTH / 2 * (1 + across))


def _square(picture: Picture, middle: tuple[int, int], side: int, colour: tuple[int, ...]) -> None:
    """Draw a square."""
    row, column = (max(at - side // 2, 0) for at in middle)
    picture[row : row + side, column : column + side] = colour


def episode(random: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.floating]]:
    """Return the hand's places `[LENGTH, 2]` on its way to a box, and the box's place `[2]`."""
    box, start = random.uniform(-0.4, 0.4, 2), random.uniform(-0.05, 0.05, 2)
    share = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, LENGTH))[:, None]
    return (start + share * (box - start)).astype(np.float32), box


def demonstrations(random: np.random.Generator, tables: dict[str, Picture]) -> Demonstrations:
    """Return demonstrations with reduced pictures."""
    episodes = []
    for index in range(SHOWN):
        hand, box = episode(random)
        pictures = {
            camera: np.stack([reduce(drawn(table, camera, at, box)) for at in hand])
            for camera, table in tables.items()
        }
        state = torch.from_numpy(hand)
        action = torch.cat([state[1:], state[-1:]])
        empty = torch.empty(LENGTH, 0)
        episodes.append(Demonstration(index, "go", state, empty, action, pictures=pictures))
    names = {"observation.state": ("x", "y"), "action": ("x", "y")}
    return Demonstrations(FPS, names, tuple(episodes))


def measure() -> list[Table]:
    """Measure fitting, and steps in unseen episodes."""
    random = np.random.default_rng(0)
    tables = tables_of(random)
    shown = demonstrations(random, tables)
    _steps(_fitted(shown), random, tables)  # compiles
    began = time.perf_counter()
    imitator = _fitted(shown)
    fitting = time.perf_counter() - began
    times = np.concatenate([_steps(imitator, random, tables) for _ in range(STEPS // LENGTH)])
    rows = [("fit [s]", number(fitting), NOTHING, f"≤ {FIT_WANTED}")]
    p50, p99 = np.percentile(times, (50, 99)) / 1e3
    rows.append(("step [ms]", number(p50), number(p99), f"≤ {STEP_WANTED}"))
    kinds = "none" if imitator.cameras is None else ", ".join(imitator.cameras.features)
    title = f"Seeing by {len(CAMERAS)} cameras"
    return [Table(title, f"{TEXT} Cameras used: {kinds}.", ("what", "p50", "p99", "wanted"), rows)]


def _fitted(shown: Demonstrations) -> Imitator:
    """Return an imitator that has learned."""
    imitator = Imitator.from_demonstrations(shown)
    imitator.learn(shown)
    return imitator


def _steps(
    imitator: Imitator, random: np.random.Generator, tables: dict[str, Picture]
) -> NDArray[np.floating]:
    """Return the time of each step `[LENGTH]` of an episode [µs]."""
    hand, box = episode(random)
    frames = [
        (at, {camera: drawn(table, camera, at, box) for camera, table in tables.items()})
        for at in hand
    ]
    imitator.reset()
    return latencies(lambda frame: imitator.step(frame[0], pictures=frame[1]), frames)


if __name__ == "__main__":
    run_alone(__doc__, measure)
