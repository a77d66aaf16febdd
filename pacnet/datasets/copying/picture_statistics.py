"""Statistics of images and videos, carried over from the dataset that is copied.

They are of channels, `[C, 1, 1]` from 0 to 1; computing them would take decoding every picture.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pacnet.datasets.copying.source import Source
from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.appending import STATISTICS
from pacnet.datasets.format.shades import Found, checked, joined
from pacnet.datasets.format.statistics import NAMES
from pacnet.datasets.format.tables import read_episode_rows, read_json_lines

_OLD_STATISTICS = "meta/episodes_stats.jsonl"  # of format v2.1


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
        plausible = {name: checked(name, found.get(name), episode.length) for name in features}
        of_episodes.append({name: one for name, one in plausible.items() if one is not None})
    of_all = {}
    whole = _read_json(source.root / STATISTICS) if features else {}
    n_frames = sum(episode.length for episode in source.episodes)
    for name in features:
        parts = [found[name] for found in of_episodes if name in found]
        stored = checked(name, whole.get(name), n_frames)
        whole_of_parts = joined(parts) if len(parts) == len(of_episodes) else None
        first, second = (stored, whole_of_parts) if source.is_whole else (whole_of_parts, stored)
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
