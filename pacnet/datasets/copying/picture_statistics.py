"""Statistics of images and videos, carried over from the dataset that is copied.

They are of channels, `[C, 1, 1]` from 0 to 1; computing them would take decoding every picture.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.copying.source import Source
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.appending import STATISTICS
from pacnet.datasets.format.statistics import NAMES, QUANTILES
from pacnet.datasets.format.tables import read_episode_rows, read_json_lines

_OLD_STATISTICS = "meta/episodes_stats.jsonl"  # of format v2.1
_MOMENTS = ("min", "max", "mean", "std")

Found = dict[str, NDArray[Any]]
"""Statistic -> its values `[C, 1, 1]`; the count is `[1]`."""


class PictureStatistics(NamedTuple):
    """Statistics of images and videos."""

    of_episodes: list[dict[str, Found]]  # of each episode: feature -> statistics, if there are any
    of_all: dict[str, Found]


def picture_statistics(source: Source, features: Sequence[str]) -> PictureStatistics:
    """Return the statistics of these features that the source has, where they are plausible."""
    by_number = _of_episodes(source, features) if features else {}
    of_episodes = []
    for episode in source.episodes:
        found = by_number.get(episode.number, {})
        checked = {name: _checked(name, found.get(name), episode.length) for name in features}
        of_episodes.append({name: one for name, one in checked.items() if one is not None})
    of_all = {}
    whole = _read_json(source.root / STATISTICS) if features else {}
    n_frames = sum(episode.length for episode in source.episodes)
    for name in features:
        parts = [found[name] for found in of_episodes if name in found]
        stored = _checked(name, whole.get(name), n_frames)
        joined = _joined(parts) if len(parts) == len(of_episodes) else None
        first, second = (stored, joined) if source.is_whole else (joined, stored)
        best = second if first is None else first
        if best is not None:
            of_all[name] = best
    return PictureStatistics(of_episodes, of_all)


def _of_episodes(source: Source, features: Sequence[str]) -> dict[int, dict[str, Any]]:
    """Return what the source stores: episode -> feature -> statistic -> values."""
    try:
        if (source.root / _OLD_STATISTICS).is_file():
            lines = read_json_lines(source.root / _OLD_STATISTICS)
            found = {line.get("episode_index"): line.get("stats") for line in lines}
            return {
                index: stats
                for index, stats in found.items()
                if isinstance(index, int) and isinstance(stats, dict)
            }
        return {} if source.is_old else _of_rows(source.root, features)
    except DatasetError:
        return {}


def _of_rows(root: Path, features: Sequence[str]) -> dict[int, dict[str, Any]]:
    columns = {f"stats/{name}/{kind}": (name, kind) for name in features for kind in NAMES}
    found: dict[int, dict[str, Any]] = {}
    for row in read_episode_rows(root, [*columns]):
        stats: dict[str, Any] = {name: {} for name in features}
        for column, (name, kind) in columns.items():
            if column in row:
                stats[name][kind] = row[column]
        found[row["episode_index"]] = stats
    return found


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _checked(name: str, stored: object, n_frames: int) -> Found | None:
    """Return statistics as arrays, or None if they cannot be those of pictures.

    Format v2.0 has no count; LeRobot needs one to append to them.
    """
    if not isinstance(stored, Mapping):
        return None
    found = {kind: stored.get(kind) for kind in (*_MOMENTS, *QUANTILES)}
    arrays = {kind: _array(values) for kind, values in found.items() if values is not None}
    shapes = {values.shape for values in arrays.values()}
    shape = next(iter(shapes)) if len(shapes) == 1 else ()
    if len(shape) != 3 or shape[1:] != (1, 1) or not {*_MOMENTS} <= {*arrays}:
        return None
    if "image" in name and shape != (3, 1, 1):  # LeRobot would refuse to append
        return None
    low, high, mean, std = (arrays[kind] for kind in _MOMENTS)
    if not ((low <= mean) & (mean <= high) & (std >= 0)).all():
        return None
    count = _array(stored.get("count"))
    if count.shape != (1,) or count[0] < 1:
        count = np.array([n_frames])
    return arrays | {"count": count.astype(np.int64)}


def _array(values: object) -> NDArray[Any]:
    """Return finite numbers as an array; an empty one if these are not such."""
    try:
        array = np.array(values)
    except ValueError:
        return np.empty(0)
    numbers = array.dtype.kind in "iuf" and np.isfinite(array).all()
    return array if numbers else np.empty(0)


def _joined(parts: Sequence[Found]) -> Found:
    """Return the statistics of several episodes; quantiles are averaged, as LeRobot does."""
    counts = np.stack([part["count"] for part in parts])[..., None, None]  # [E, 1, 1, 1]
    weights = counts / counts.sum()
    stacked = {
        kind: np.stack([part[kind] for part in parts])
        for kind in (*_MOMENTS, *QUANTILES)
        if all(kind in part for part in parts)
    }
    mean = (stacked["mean"] * weights).sum(axis=0)
    spread = stacked["std"] ** 2 + (stacked["mean"] - mean) ** 2
    found = {kind: (stacked[kind] * weights).sum(axis=0) for kind in QUANTILES if kind in stacked}
    return found | {
        "min": stacked["min"].min(axis=0),
        "max": stacked["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt((spread * weights).sum(axis=0)),
        "count": counts.sum(axis=0).reshape(1),
    }
