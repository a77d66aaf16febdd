"""Datasets in the layouts of LeRobot's formats v3.0, v2.1 and v2.0, written without LeRobot.

`write_v30`, `write_v21` and `write_v20` write the same episodes, each in its layout.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from video_files import png, write_video

_DATA = {
    "v3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "v2": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
}
_VIDEOS = {
    "v3.0": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    "v2": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
}
_INDICES = {"timestamp": "float32"} | dict.fromkeys(
    ("frame_index", "episode_index", "index", "task_index"), "int64"
)


@dataclass(frozen=True)
class Shown:
    """One episode.

    Attributes:
        task: its task, or one for each frame.
        values: feature -> numbers `[T]` (stored as scalars) or `[T, ...]`, or texts.
        images: feature -> pictures `[T, H, W, 3]` uint8, stored as PNG in the data files.
        videos: feature -> pictures `[T, H, W, 3]` uint8, stored in video files.
    """

    task: str | Sequence[str]
    values: Mapping[str, Any]
    images: Mapping[str, np.ndarray] = field(default_factory=dict)
    videos: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(next(iter(self.values.values())))

    @property
    def tasks(self) -> list[str]:
        """The task of each frame."""
        return [self.task] * len(self) if isinstance(self.task, str) else [*self.task]


def write_v30(root: Path, episodes: Sequence[Shown], fps: int = 10, per_file: int = 2) -> Path:
    """Write a dataset of format v3.0, at most `per_file` episodes to a data or video file."""
    tasks, rows, start = _task_indices(episodes), [], 0
    for number, first in enumerate(range(0, len(episodes), per_file)):
        group = episodes[first : first + per_file]
        tables, elapsed = [], 0.0
        for episode, shown in enumerate(group, first):
            tables.append(_table(shown, fps, episode, start, tasks))
            row = _episode_row(episode, shown) | {
                "data/chunk_index": 0, "data/file_index": number,
                "dataset_from_index": start, "dataset_to_index": start + len(shown),
                "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
            }  # fmt: skip
            for key in shown.videos:
                row |= {
                    f"videos/{key}/chunk_index": 0, f"videos/{key}/file_index": number,
                    f"videos/{key}/from_timestamp": elapsed,
                    f"videos/{key}/to_timestamp": elapsed + len(shown) / fps,
                }  # fmt: skip
            for name, found in _statistics(shown).items():
                row |= {f"stats/{name}/{kind}": value for kind, value in found.items()}
            rows.append(row)
            start, elapsed = start + len(shown), elapsed + len(shown) / fps
        place = {"chunk_index": 0, "file_index": number}
        _write_table(root / _DATA["v3.0"].format(**place), pa.concat_tables(tables))
        for key in group[0].videos:
            frames = np.concatenate([shown.videos[key] for shown in group])
            write_video(root / _VIDEOS["v3.0"].format(video_key=key, **place), frames, fps)
    _write_table(root / "meta/episodes/chunk-000/file-000.parquet", pa.Table.from_pylist(rows))
    texts = {"task_index": [*tasks.values()], "task": [*tasks]}
    _write_table(root / "meta/tasks.parquet", pa.table(texts))
    _write_json(root / "meta/stats.json", _all_statistics(episodes))
    _write_info(root, "v3.0", episodes, fps, {"data_files_size_in_mb": 100})
    return root


def write_v21(root: Path, episodes: Sequence[Shown], fps: int = 10, chunks_size: int = 2) -> Path:
    """Write a dataset of format v2.1: the statistics are of each episode."""
    lines = [
        {"episode_index": index, "stats": _statistics(shown)}
        for index, shown in enumerate(episodes)
    ]
    _write_lines(root / "meta/episodes_stats.jsonl", lines)
    return _write_v2(root, "v2.1", episodes, fps, chunks_size)


def write_v20(root: Path, episodes: Sequence[Shown], fps: int = 10, chunks_size: int = 2) -> Path:
    """Write a dataset of format v2.0: the statistics are of all episodes."""
    _write_json(root / "meta/stats.json", _all_statistics(episodes))
    return _write_v2(root, "v2.0", episodes, fps, chunks_size)


WRITERS = {"v3.0": write_v30, "v2.1": write_v21, "v2.0": write_v20}


def _write_v2(
    root: Path, version: str, episodes: Sequence[Shown], fps: int, chunks_size: int
) -> Path:
    tasks, start = _task_indices(episodes), 0
    for index, shown in enumerate(episodes):
        place = {"episode_chunk": index // chunks_size, "episode_index": index}
        _write_table(root / _DATA["v2"].format(**place), _table(shown, fps, index, start, tasks))
        for key, frames in shown.videos.items():
            write_video(root / _VIDEOS["v2"].format(video_key=key, **place), frames, fps)
        start += len(shown)
    lines = [{"task_index": index, "task": task} for task, index in tasks.items()]
    _write_lines(root / "meta/tasks.jsonl", lines)
    rows = [_episode_row(index, shown) for index, shown in enumerate(episodes)]
    _write_lines(root / "meta/episodes.jsonl", rows)
    n_chunks = -(-len(episodes) // chunks_size)
    counts = {
        "total_videos": sum(len(shown.videos) for shown in episodes),
        "total_chunks": n_chunks,
        "chunks_size": chunks_size,
    }
    _write_info(root, version, episodes, fps, counts)
    return root


def edit_info(root: Path, **changes: Any) -> None:
    """Change entries of a dataset's info.json; None deletes one."""
    path = root / "meta/info.json"
    info = json.loads(path.read_text()) | changes
    _write_json(path, {name: value for name, value in info.items() if value is not None})


def _task_indices(episodes: Sequence[Shown]) -> dict[str, int]:
    texts = dict.fromkeys(task for shown in episodes for task in shown.tasks)
    return {task: index for index, task in enumerate(texts)}


def _episode_row(index: int, shown: Shown) -> dict[str, Any]:
    return {
        "episode_index": index, "tasks": [*dict.fromkeys(shown.tasks)], "length": len(shown)
    }  # fmt: skip


def _table(shown: Shown, fps: int, episode: int, start: int, tasks: Mapping[str, int]) -> pa.Table:
    columns = {name: _column(values) for name, values in shown.values.items()}
    for name, frames in shown.images.items():
        columns[name] = pa.array([{"bytes": png(frame), "path": None} for frame in frames])
    times = np.arange(len(shown))
    return pa.table(
        columns
        | {
            "timestamp": (times / fps).astype(np.float32),
            "frame_index": times,
            "episode_index": np.full_like(times, episode),
            "index": start + times,
            "task_index": [tasks[task] for task in shown.tasks],
        }
    )


def _column(values: Any) -> pa.Array:
    array = np.asarray(values)
    kind = pa.string() if array.dtype.kind in "UO" else pa.from_numpy_dtype(array.dtype)
    for _ in array.shape[1:]:
        kind = pa.list_(kind)
    return pa.array(array.tolist(), kind)


def _statistics(shown: Shown) -> dict[str, Any]:
    """Return what LeRobot writes: numbers by dimension, pictures by channel from 0 to 1."""
    found = {}
    for name, values in shown.values.items():
        rows = np.asarray(values)
        if rows.dtype.kind not in "UO":
            found[name] = _of_rows(
                rows.reshape(len(rows), -1).astype(float), rows.shape[1:] or (1,)
            )
    for name, frames in {**shown.images, **shown.videos}.items():
        found[name] = _of_rows(frames.reshape(-1, 3) / 255, (3, 1, 1)) | {"count": [len(frames)]}
    return found


def _of_rows(rows: np.ndarray, shape: tuple[int, ...]) -> dict[str, Any]:
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    lists = {name: values.reshape(shape).tolist() for name, values in found.items()}
    return lists | {"count": [len(rows)]}


def _all_statistics(episodes: Sequence[Shown]) -> dict[str, Any]:
    first = episodes[0]
    joined = {
        kind: {
            name: np.concatenate([getattr(shown, kind)[name] for shown in episodes])
            for name in getattr(first, kind)
        }
        for kind in ("values", "images", "videos")
    }
    return _statistics(Shown("", **joined))


def _write_info(
    root: Path, version: str, episodes: Sequence[Shown], fps: int, more: Mapping[str, Any]
) -> None:
    first, layout = episodes[0], "v3.0" if version == "v3.0" else "v2"
    features: dict[str, Any] = {
        name: _description(np.asarray(rows)) for name, rows in first.values.items()
    }
    for dtype, pictures_of in (("image", first.images), ("video", first.videos)):
        names = ["height", "width", "channels"]
        for name, frames in pictures_of.items():
            features[name] = {"dtype": dtype, "shape": [*frames.shape[1:]], "names": names}
    for name, dtype in _INDICES.items():
        features[name] = {"dtype": dtype, "shape": [1], "names": None}
    tasks = _task_indices(episodes)
    info = {
        "codebase_version": version, "robot_type": "hand", "total_episodes": len(episodes),
        "total_frames": sum(map(len, episodes)), "total_tasks": len(tasks), "chunks_size": 1000,
        "fps": fps, "splits": {"train": f"0:{len(episodes)}"}, "data_path": _DATA[layout],
        "video_path": _VIDEOS[layout] if first.videos else None, "features": features,
    }  # fmt: skip
    _write_json(root / "meta/info.json", {**info, **more})


def _description(rows: np.ndarray) -> dict[str, Any]:
    dtype = "string" if rows.dtype.kind in "UO" else str(rows.dtype)
    shape = [*rows.shape[1:]] or [1]
    names = [f"d{index}" for index in range(shape[0])] if len(shape) == 1 else None
    return {"dtype": dtype, "shape": shape, "names": names}


def _write_table(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)


def _write_json(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def _write_lines(path: Path, lines: Sequence[Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
