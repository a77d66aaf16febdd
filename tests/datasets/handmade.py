"""A small dataset laid out by hand after the formats v3.0, v2.1 and v2.0: columns and files."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FEATURES = {"observation.state": 3, "observation.environment_state": 2, "action": 1}
LENGTHS = (4, 1, 3)
TASKS = ("drink", "wave", "drink")
FPS = 50


def columns(seed: int = 0) -> dict[str, np.ndarray]:
    """Every frame of three episodes: features [8, D] and the format's own columns [8]."""
    rng = np.random.default_rng(seed)
    total = sum(LENGTHS)
    frames = {name: rng.normal(size=(total, size)).astype("f4") for name, size in FEATURES.items()}
    frames["index"] = np.arange(total)
    frames["episode_index"] = np.repeat(np.arange(3), LENGTHS)
    frames["frame_index"] = np.concatenate([np.arange(length) for length in LENGTHS])
    frames["task_index"] = np.repeat([0, 1, 0], LENGTHS)
    frames["timestamp"] = (frames["frame_index"] / FPS).astype("f4")
    return frames


def to_arrow(values: np.ndarray) -> pa.Array:
    """A column as LeRobot stores it: vectors in lists of fixed size, of length 1 as scalars."""
    if values.ndim == 1 or values.shape[1] == 1:
        return pa.array(values.ravel())
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def write_info(root: Path, **changes: object) -> None:
    features = {
        name: {"dtype": "float32", "shape": [size], "names": [f"{name}_{i}" for i in range(size)]}
        for name, size in FEATURES.items()
    }
    info = {
        "codebase_version": "v3.0",
        "fps": FPS,
        "total_episodes": len(LENGTHS),
        "total_frames": sum(LENGTHS),
        "features": features,
    }
    (root / "meta").mkdir(parents=True, exist_ok=True)
    (root / "meta" / "info.json").write_text(json.dumps(info | changes))


def write_rows(root: Path, frames: dict[str, np.ndarray], rows: list[int], file: str) -> Path:
    path = root / "data" / file
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table({name: to_arrow(frames[name][rows]) for name in frames}), path)
    return path


def write_tasks(root: Path, words: str = "task") -> None:
    table = pa.table({"task_index": [0, 1], words: ["drink", "wave"]})
    pq.write_table(table, root / "meta" / "tasks.parquet")


def write(root: Path, frames: Mapping[str, np.ndarray] | None = None) -> Path:
    """A sound dataset of format v3.0 in one data file."""
    frames = dict(frames or columns())
    write_info(root)
    write_tasks(root)
    write_rows(root, frames, list(range(len(frames["index"]))), "chunk-000/file-000.parquet")
    return root


def write_episodes(root: Path, lengths: Mapping[int, int]) -> None:
    """The list of episodes of format v3.0, two of them in each data file."""
    rows = [
        {"episode_index": episode, "length": length, "tasks": [TASKS[episode]],
         "data/chunk_index": 0, "data/file_index": episode // 2}
        for episode, length in lengths.items()
    ]  # fmt: skip
    path = root / "meta/episodes/chunk-000/file-000.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), path)


def write_old(root: Path, version: str, frames: Mapping[str, np.ndarray] | None = None) -> Path:
    """The same of format v2.0 or v2.1, in float64; a task that no frame is about is added."""
    frames = dict(frames or columns())
    write_info(root, codebase_version=version)
    tasks = [{"task_index": index, "task": task} for index, task in enumerate(["drink", "wave"])]
    write_lines(root / "meta/tasks.jsonl", [*tasks, {"task_index": 2, "task": "valid"}])
    listed = [
        {"episode_index": episode, "tasks": [task, "valid"], "length": length}
        for episode, (task, length) in enumerate(zip(TASKS, LENGTHS, strict=True))
    ]
    write_lines(root / "meta/episodes.jsonl", listed)
    for episode in np.unique(frames["episode_index"]):
        rows = np.flatnonzero(frames["episode_index"] == episode).tolist()
        path = write_rows(root, frames, rows, f"chunk-000/episode_{episode:06}.parquet")
        table = pq.read_table(path)
        for place, name in enumerate(table.column_names):
            if name in FEATURES:
                doubles = pa.array(frames[name][rows].astype("f8").tolist())
                table = table.set_column(place, name, doubles)
        pq.write_table(table, path)
    return root


def write_lines(path: Path, lines: list[dict[str, object]]) -> None:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
