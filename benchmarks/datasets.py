"""Recording and reading datasets, compared with LeRobot's own writer and reader.

Run it alone with `python -m benchmarks.datasets`, in an environment of each LeRobot.
`python -m benchmarks datasets --also PYTHON` also measures the LeRobot of a second environment.
"""

from __future__ import annotations

import itertools
import json
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.harness import NOTHING, Candidate, Table, factor, median_times, number, run_alone
from benchmarks.machine import version_of
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError
from pacnet.datasets.recorder import Recorder, recover

EPISODES, LENGTH, DIMENSIONS, FPS = 30, 1000, 6, 50
FRAMES = EPISODES * LENGTH
NAMES = tuple(f"joint {number}" for number in range(DIMENSIONS))
STATE = "observation.state"
SAMPLED = 500  # frames read by index
OLD_FILES, OLD_LENGTH, OLD_DIMENSIONS = 100, 360, 30
KILLED_AFTER = 20  # episodes
PACKAGES = ("lerobot", "torch", "pyarrow")  # named with their versions in the tables
WANTED_WRITING, WANTED_READING, WANTED_OLDER = 5, 20, 1000  # times faster, and ms

WRITING = f"""Writing {EPISODES} episodes of {LENGTH:,} frames of {DIMENSIONS} numbers to a new
dataset, without imports. LeRobot receives whole episodes (`save_episode(episode_data=...)`), its
fastest way. `Recorder` flushes every episode to the disk before it continues.
"""
READING = f"""All {FRAMES:,} frames of such a dataset as tensors. `ds[i]` is LeRobot's access to one
frame, measured over {SAMPLED} random frames. LeRobot's dataset is already open, while
`load_demonstrations` starts from the files.
"""
OLDER = f"""{OLD_FILES} episodes of {OLD_LENGTH} frames in format v2.1, in a file each:
{OLD_DIMENSIONS} numbers perceived and as many in the action, in float64. pyarrow reads the two
columns of all files and no more: no tasks, no time, no checks.
"""
KILLING = f"""A process that records such a dataset is killed as soon as `save_episode` has returned
for the {KILLED_AFTER}th time. Then the dataset is recovered, if there is a way to, and read.
"""
CHILD = """
from benchmarks import datasets
from pathlib import Path
datasets.{write}(Path({root!r}), lambda: print(flush=True))
"""


def episodes(seed: int = 0) -> Iterator[np.ndarray]:
    """Yield the episodes, float32 `[LENGTH, DIMENSIONS]`."""
    rng = np.random.default_rng(seed)
    for _ in range(EPISODES):
        yield rng.standard_normal((LENGTH, DIMENSIONS), np.float32).cumsum(axis=0)


def write_ours(root: Path, after_episode: Callable[[], None] = lambda: None) -> None:
    """Record all episodes with `Recorder`; call `after_episode` after each."""
    with Recorder(root, FPS, {STATE: NAMES}) as recorder:
        for episode in episodes():
            recorder.save_episode("task", {STATE: episode})
            after_episode()


def write_stock(root: Path, after_episode: Callable[[], None] = lambda: None) -> None:
    """Record the same with LeRobot."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    features = {STATE: {"dtype": "float32", "shape": (DIMENSIONS,), "names": list(NAMES)}}
    dataset = LeRobotDataset.create(
        "local/stock", FPS, features, root=root, use_videos=False, video_backend="pyav"
    )
    time = np.arange(LENGTH)
    for count, episode in enumerate(episodes()):
        columns: dict[str, Any] = {"size": LENGTH, "task": ["task"] * LENGTH, STATE: episode}
        columns |= {"frame_index": time, "timestamp": time / FPS, "episode_index": count}
        dataset.save_episode(columns | {"index": (), "task_index": ()})
        after_episode()
    dataset.finalize()


@contextmanager
def quiet_lerobot() -> Iterator[Path]:
    """Yield a folder to work in, which also holds the cache of the library LeRobot reads with."""
    import datasets

    datasets.disable_progress_bars()
    with tempfile.TemporaryDirectory() as folder:
        datasets.config.HF_DATASETS_CACHE = Path(folder) / "cache"
        yield Path(folder)


def into_new_folders(write: Callable[[Path], None], folder: Path) -> Candidate:
    """Return a candidate that writes a dataset."""
    numbers = itertools.count()

    def prepare() -> Callable[[], None]:
        root = folder / f"{write.__name__}{next(numbers)}"
        return lambda: write(root)

    return prepare


def measure_writing(folder: Path) -> Table:
    """Measure both writers."""
    candidates = {"LeRobot": write_stock, "`pacnet.Recorder`": write_ours}
    prepared = {name: into_new_folders(write, folder) for name, write in candidates.items()}
    stock, ours = median_times(prepared, budget=60, most=5).values()
    names = [*candidates]
    rows = [
        (names[0], number(stock), NOTHING, NOTHING),
        (names[1], number(ours), factor(stock / ours), f"≥ {WANTED_WRITING} ×"),
    ]
    return _table("Recording a dataset", WRITING, ("who", "s", "faster", "wanted"), rows)


def measure_reading(folder: Path) -> Table:
    """Measure both readers."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    root = folder / "read"
    write_ours(root)
    dataset = LeRobotDataset("local/read", root=root, video_backend="pyav")
    sampled = np.random.default_rng(0).choice(FRAMES, SAMPLED, replace=False).tolist()
    runs: dict[str, Callable[[], object]] = {
        "`ds[i]`": lambda: [dataset[index] for index in sampled],
        "`ds.hf_dataset` in tensors at once": lambda: dataset.hf_dataset.with_format("torch")[:],
        "`load_demonstrations`": lambda: load_demonstrations(root, action=None),
    }
    times = median_times({name: lambda run=run: run for name, run in runs.items()})
    times["`ds[i]`"] *= FRAMES / SAMPLED
    stock = times["`ds[i]`"]
    rows = [
        (name, number(1e3 * time), factor(stock / time), NOTHING) for name, time in times.items()
    ]
    rows[0] = (*rows[0][:2], NOTHING, NOTHING)
    rows[-1] = (*rows[-1][:3], f"≥ {WANTED_READING} ×")
    return _table("Reading a dataset", READING, ("who", "ms", "faster", "wanted"), rows)


def write_older(root: Path) -> None:
    """Write a dataset of format v2.1."""
    rng, shape = np.random.default_rng(0), (OLD_LENGTH, OLD_DIMENSIONS)
    features = {name: {"dtype": "float64", "shape": shape[1:]} for name in (STATE, "action")}
    (root / "meta").mkdir(parents=True)
    (root / "data/chunk-000").mkdir(parents=True)
    info = {"codebase_version": "v2.1", "fps": FPS, "features": features}
    (root / "meta/info.json").write_text(json.dumps(info))
    (root / "meta/tasks.jsonl").write_text('{"task_index": 0, "task": "task"}')
    time = np.arange(OLD_LENGTH)
    for episode in range(OLD_FILES):
        columns = {name: rng.standard_normal(shape).tolist() for name in features}
        columns |= {"timestamp": time / FPS, "frame_index": time, "task_index": 0 * time}
        columns |= {"episode_index": 0 * time + episode, "index": episode * OLD_LENGTH + time}
        pq.write_table(pa.table(columns), root / f"data/chunk-000/episode_{episode:06}.parquet")


def measure_older(folder: Path) -> Table:
    """Measure the reading of a dataset in many files."""
    root = folder / "older"
    write_older(root)

    def read_columns() -> list[np.ndarray]:
        table = pq.read_table(root / "data", columns=[STATE, "action"])
        flat = [column.combine_chunks().flatten() for column in table.columns]
        return [column.to_numpy().reshape(-1, OLD_DIMENSIONS).astype("f4") for column in flat]

    runs: dict[str, Callable[[], object]] = {
        "pyarrow, two columns": read_columns,
        "`load_demonstrations`": lambda: load_demonstrations(root),
    }
    times = median_times({name: lambda run=run: run for name, run in runs.items()})
    rows = [(name, number(1e3 * time), NOTHING) for name, time in times.items()]
    rows[-1] = (*rows[-1][:2], f"≤ {WANTED_OLDER:,}")
    return _table("Reading format v2.1", OLDER, ("who", "ms", "wanted"), rows)


def measure_killing(folder: Path) -> Table:
    """Measure what both writers leave when they are killed."""
    rows = []
    for name, write in {"LeRobot": write_stock, "`Recorder`": write_ours}.items():
        root = folder / f"killed_{write.__name__}"
        code = CHILD.format(write=write.__name__, root=str(root))
        command = [sys.executable, "-c", code]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        ) as process:
            assert process.stdout is not None
            for _ in range(KILLED_AFTER):
                process.stdout.readline()
            process.kill()
        rows.append((name, str(KILLED_AFTER), str(count_episodes(root))))
    return _table("A recording that is killed", KILLING, ("who", "saved", "read"), rows)


def count_episodes(root: Path) -> int:
    """Return the number of readable episodes that a killed process left."""
    recover(root)
    try:
        return len(load_demonstrations(root, action=None))
    except DatasetError:
        return 0


def _table(title: str, text: str, columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    """Return a table whose text names the versions, which may be of a second environment."""
    versions = [f"{name} {version_of(name)}" for name in PACKAGES]
    text = f"{text}Measured with {', '.join(versions)} and Python {platform.python_version()}."
    return Table(f"{title}, LeRobot {version_of('lerobot')}", text, columns, rows)


def measure() -> list[Table]:
    """Measure writing, reading, and being killed."""
    try:
        with quiet_lerobot() as folder:
            measures = (measure_writing, measure_reading, measure_older, measure_killing)
            return [measure(folder) for measure in measures]
    except ImportError:
        return [Table("Datasets", WRITING, ("who", "s"), [("needs LeRobot", NOTHING)])]


if __name__ == "__main__":
    run_alone(__doc__, measure)
