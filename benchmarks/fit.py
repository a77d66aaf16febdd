"""The time of `pacnet fit`, from the command to the checkpoint, including imports.

Run it alone with `python -m benchmarks.fit`.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.harness import Table, number, run_alone
from pacnet.datasets.recorder import Recorder

EPISODES, LENGTH, FPS, JOINTS = 30, 1000, 50, 11
DIMENSIONS = 28
RUNS = 5
WANTED = 6  # [s]

TEXT = f"""A dataset of {EPISODES} episodes of {LENGTH:,} frames: {DIMENSIONS} dimensions perceived,
{JOINTS} actions, noisy laps on one smooth closed path at different paces. Median over {RUNS} fresh
processes. All kernels were compiled before.
"""


def episode(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return percepts `[LENGTH, DIMENSIONS]` and actions `[LENGTH, JOINTS]`."""
    path = np.random.default_rng(0).standard_normal((2, 3, DIMENSIONS))  # of all episodes
    laps = rng.uniform(0.9, 1.1)
    angle = np.linspace(0, 2 * np.pi * laps, LENGTH + 1)[:, None, None] * np.arange(1, 4)[:, None]
    course = (np.sin(angle) * path[0] + np.cos(angle) * path[1]).sum(axis=1)
    noise = 0.02 * rng.standard_normal((LENGTH, DIMENSIONS))
    return (course[:-1] + noise).astype(np.float32), course[1:, :JOINTS].astype(np.float32)


def record(root: Path) -> None:
    """Record the dataset."""
    rng = np.random.default_rng(1)
    features = {
        "observation.state": tuple(f"state {number}" for number in range(DIMENSIONS)),
        "action": tuple(f"joint {number}" for number in range(JOINTS)),
    }
    with Recorder(root, FPS, features) as recorder:
        for _ in range(EPISODES):
            percepts, actions = episode(rng)
            frames = {"observation.state": percepts, "action": actions}
            recorder.save_episode("go round", frames)


def measure() -> list[Table]:
    """Measure the command's time."""
    with tempfile.TemporaryDirectory() as folder:
        dataset, out = Path(folder) / "laps", Path(folder) / "imitator"
        record(dataset)
        command = [sys.executable, "-m", "pacnet", "fit", str(dataset), "--out", str(out)]
        times = []
        for run in range(RUNS + 1):  # the first may compile
            start = time.perf_counter()
            subprocess.run([*command, "--overwrite"], check=True, capture_output=True)
            if run:
                times.append(time.perf_counter() - start)
    rows = [("`pacnet fit`", number(statistics.median(times)), f"≤ {WANTED}")]
    title = f"`pacnet fit`, {EPISODES * LENGTH:,} × {DIMENSIONS}"
    return [Table(title, TEXT, ("what", "s", "wanted"), rows)]


if __name__ == "__main__":
    run_alone(__doc__, measure)
