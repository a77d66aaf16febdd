"""Decoding a camera's pictures, compared with LeRobot's access to one frame, and recording them.

Run it alone with `python -m benchmarks.pictures`.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.harness import NOTHING, Table, factor, number, run_alone
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.pictures import reduce
from pacnet.datasets.recorder import Picture, Recorder

TOP, STATE = "observation.images.top", "observation.state"
HEIGHT, WIDTH, FPS = 480, 640, 30
EPISODES, LENGTH = 4, 150
FRAMES = EPISODES * LENGTH
SAMPLED = 100  # frames read by index

TEXT = f"""{EPISODES} episodes of {LENGTH} pictures of {WIDTH}x{HEIGHT}, milliseconds a picture, of
a CPU and of a clock. `Recorder` compresses pictures while they are added, and encodes the video at
its end. `load_demonstrations` decodes all in sequence and reduces them to 128 pixels; the second
time they come from its cache. `ds[i]` is LeRobot's access to one frame, which it does not reduce;
over {SAMPLED} random frames.
"""


def episode(seed: int) -> np.ndarray:
    """Return pictures `[LENGTH, HEIGHT, WIDTH, 3]` that move, with a little noise."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(40, 200, (HEIGHT // 40, WIDTH // 40, 3))
    still = coarse.repeat(40, 0).repeat(40, 1) + rng.integers(0, 4, (HEIGHT, WIDTH, 3))
    return np.stack([np.roll(still, 2 * frame, 1) for frame in range(LENGTH)]).astype(np.uint8)


def write(root: Path, episodes: Sequence[np.ndarray]) -> None:
    """Record episodes."""
    features = {TOP: Picture(HEIGHT, WIDTH), STATE: ("x",), "action": ("u",)}
    rows = np.zeros((LENGTH, 1))
    with Recorder(root, FPS, features) as recorder:
        for pictures in episodes:
            recorder.save_episode("task", {TOP: pictures, STATE: rows, "action": rows})


def spent(run: Callable[[], object], frames: int) -> tuple[float, float]:
    """Return the time of a CPU and of a clock for a frame [ms]."""
    cpu, clock = time.process_time(), time.perf_counter()
    run()
    return 1e3 * (time.process_time() - cpu) / frames, 1e3 * (time.perf_counter() - clock) / frames


def measure() -> list[Table]:
    """Measure recording, decoding, and what LeRobot takes."""
    episodes = [*map(episode, range(EPISODES))]
    picture = episodes[0][0]
    reduce(picture)  # compiles the kernel
    times: dict[str, tuple[float, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "seen"
        with patch.dict(os.environ, PACNET_CACHE=folder):
            times["`Recorder`"] = spent(lambda: write(root, episodes), FRAMES)
            stock = _lerobot(root)
            if stock is not None:
                times["`ds[i]`"] = stock
            for name in ("`load_demonstrations`", "the same again"):
                times[name] = spent(lambda: load_demonstrations(root, cameras="all"), FRAMES)
    times["`reduce`, a live picture"] = spent(lambda: [reduce(picture) for _ in range(100)], 100)
    rows = [
        (
            name,
            *map(number, pair),
            factor(stock[0] / pair[0]) if stock and name.startswith("`load") else NOTHING,
        )
        for name, pair in times.items()
    ]
    return [Table("Pictures of cameras", TEXT, ("what", "CPU", "clock", "faster"), rows)]


def _lerobot(root: Path) -> tuple[float, float] | None:
    """Return what LeRobot takes; None if it is not installed."""
    try:
        from lerobot.datasets.lerobot_dataset import LeRobotDataset
    except ImportError:
        return None
    dataset = LeRobotDataset("local/seen", root=root, video_backend="pyav")
    sampled = np.random.default_rng(0).choice(FRAMES, SAMPLED, replace=False).tolist()
    _ = dataset[0]
    return spent(lambda: [dataset[index] for index in sampled], SAMPLED)


if __name__ == "__main__":
    run_alone(__doc__, measure)
