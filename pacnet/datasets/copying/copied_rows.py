"""The rows about a copy's episodes in `meta/episodes`, with their statistics."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pacnet.datasets.copying.axes import nested_column
from pacnet.datasets.copying.picture_statistics import PictureStatistics
from pacnet.datasets.format.clips import Clip
from pacnet.datasets.format.parquet import to_arrow, to_arrow_text
from pacnet.datasets.format.statistics import NAMES, statistics


def statistics_of(rows: NDArray[Any]) -> dict[str, Any]:
    """Return each statistic of values `[N, ..., D]`, `[D]` each, over all axes but the last.

    That is what LeRobot computes, and aggregates these with. Frames that are not finite do not
    count; where no frame is there are none.
    """
    if rows.dtype.kind == "f":
        rows = rows[np.isfinite(rows).reshape(len(rows), -1).all(axis=1)]
    if not len(rows):
        return {}
    return statistics(rows.reshape(-1, rows.shape[-1])) | {"count": [len(rows)]}


def copied_episodes_table(
    rows: Sequence[Mapping[str, Any]],
    numbers: Iterable[str],
    clips: Mapping[str, Sequence[Clip]],
    cameras: Sequence[str],
    pictures: PictureStatistics,
) -> pa.Table:
    """Return the table of `meta/episodes`.

    LeRobot reads all its files with the columns of the first, and so those of every statistic are
    there, with gaps where one is not known.

    Args:
        rows: the episodes as `writing.episode_row` gives them.
        numbers: the features of numbers.
        clips: camera -> the clip of each episode.
        cameras: the features of images and videos.
        pictures: their statistics.
    """
    columns: dict[str, pa.Array] = {"tasks": _text_lists([row["tasks"] for row in rows])}
    for name in [name for name, value in rows[0].items() if isinstance(value, int)]:
        columns[name] = _integers([row[name] for row in rows])
    for camera, shown in clips.items():
        columns |= {
            f"videos/{camera}/chunk_index": _integers([clip.number.chunk_index for clip in shown]),
            f"videos/{camera}/file_index": _integers([clip.number.file_index for clip in shown]),
            f"videos/{camera}/from_timestamp": _times([clip.start for clip in shown]),
            f"videos/{camera}/to_timestamp": _times([clip.stop for clip in shown]),
        }
    for column in [f"stats/{name}/{kind}" for name in numbers for kind in NAMES]:
        columns[column] = _statistic(column, [row.get(column) for row in rows], 1)
    for name in cameras:
        for kind in NAMES:
            values = [found.get(name, {}).get(kind) for found in pictures.of_episodes]
            columns[f"stats/{name}/{kind}"] = _statistic(kind, values, 3)
    return pa.table(columns)


def _statistic(name: str, values: Sequence[Any], axes: int) -> pa.Array:
    if name.endswith("count"):
        return nested_column(values, 1, "int64")
    return nested_column(values, axes)


def _integers(values: Sequence[int]) -> pa.Array:
    return to_arrow(np.array(values, dtype=np.int64)[:, None])


def _times(values: Sequence[float]) -> pa.Array:
    return to_arrow(np.array(values, dtype=np.float64)[:, None])


def _text_lists(lists: Sequence[Sequence[str]]) -> pa.Array:
    texts = to_arrow_text([text for texts in lists for text in texts])
    ends = np.cumsum([0, *map(len, lists)], dtype=np.int32)
    return pa.ListArray.from_arrays(to_arrow(ends[:, None]), texts)
