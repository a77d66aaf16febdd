"""What a dataset's description says of its episodes, apart from the frames themselves.

It is read only where data files are damaged or missing or contradict `meta/info.json`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pacnet.datasets.format import DatasetError
from pacnet.datasets.format.paths import DATA_PATH, check_data_path
from pacnet.datasets.format.tables import OLD_EPISODES, read_episode_rows, read_json_lines

_OLD_DATA_FILE = re.compile(r"episode_(\d{1,15})\.parquet", re.ASCII)
_COLUMNS = ("length", "tasks", "data/chunk_index", "data/file_index")


class ListedEpisode(NamedTuple):
    """An episode as the dataset's description lists it; None for what it does not say."""

    length: int | None  # [frames]
    task: str | None
    data_file: str | None  # path in the dataset's folder


def listed_episodes(root: Path, info: Mapping[str, Any]) -> dict[int, ListedEpisode]:
    """Return the episodes by their indices; none where their list is missing or unreadable."""
    try:
        if (root / OLD_EPISODES).is_file():
            rows = [_old_row(line) for line in read_json_lines(root / OLD_EPISODES)]
        else:
            rows = _rows(root, info)
    except DatasetError:
        return {}
    return {
        row["episode_index"]: ListedEpisode(_integer(row["length"]), row["task"], row["data_file"])
        for row in rows
        if _integer(row["episode_index"]) is not None
    }


def episode_of_old_file(path: Path) -> int | None:
    """Return the episode that a data file of formats v2.0 and v2.1 is named after."""
    match = _OLD_DATA_FILE.fullmatch(path.name)
    return None if match is None else int(match[1])


def _old_row(line: Mapping[str, Any]) -> dict[str, Any]:
    listed = {name: line.get(name) for name in ("episode_index", "length")}
    return listed | {"task": _first_text(line.get("tasks")), "data_file": None}


def _rows(root: Path, info: Mapping[str, Any]) -> list[dict[str, Any]]:
    data_path = info.get("data_path") or DATA_PATH
    check_data_path(data_path)
    found = []
    for row in read_episode_rows(root, _COLUMNS):
        numbers = [_integer(row.get(f"data/{name}")) for name in ("chunk_index", "file_index")]
        place = None
        if None not in numbers:
            place = data_path.format(chunk_index=numbers[0], file_index=numbers[1])
        kept = {name: row.get(name) for name in ("episode_index", "length")}
        found.append(kept | {"task": _first_text(row.get("tasks")), "data_file": place})
    return found


def _first_text(tasks: object) -> str | None:
    first = tasks[0] if isinstance(tasks, list) and tasks else tasks
    return first if isinstance(first, str) else None


def _integer(number: object) -> int | None:
    return number if type(number) is int and 0 <= number < 2**53 else None
