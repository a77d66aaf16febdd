"""The rows about a copy's episodes in `meta/episodes`, with statistics of any number of axes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pacnet.datasets.format.axes import nested_column
from pacnet.datasets.format.parquet import to_arrow, to_arrow_text
from pacnet.datasets.format.picture_statistics import PictureStatistics
from pacnet.datasets.format.source_videos import Clip
from pacnet.datasets.format.statistics import NAMES, statistics

Shapes = dict[str, tuple[int, ...]]
"""Feature of numbers -> its shape."""


def nested_statistics(rows: NDArray[Any], shape: Sequence[int]) -> dict[str, Any]:
    """Return each statistic of values `[N, D]` in their shape; frames not finite do not count.

    Where no frame is finite there are none.
    """
    finite = rows[np.isfinite(rows).all(axis=1)] if rows.dtype.kind == "f" else rows
    if not len(finite):
        return {}
    found = statistics(finite)
    return {
        kind: values if kind == "count" else np.reshape(values, shape).tolist()
        for kind, values in found.items()
    }


def copied_episodes_table(
    rows: Sequence[Mapping[str, Any]],
    shapes: Shapes,
    clips: Mapping[str, Sequence[Clip]],
    cameras: Sequence[str],
    pictures: PictureStatistics,
) -> pa.Table:
    """Return the table of `meta/episodes`.

    LeRobot reads all its files with the columns of the first, and so those of every statistic are
    there, with gaps where one is not known.

    Args:
        rows: the episodes as `writing.episode_row` gives them.
        shapes: the shape of each feature of numbers.
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
    for name, shape in shapes.items():
        for kind in NAMES:
            column = f"stats/{name}/{kind}"
            columns[column] = _statistic(kind, [row.get(column) for row in rows], len(shape))
    for name in cameras:
        for kind in NAMES:
            values = [found.get(name, {}).get(kind) for found in pictures.of_episodes]
            columns[f"stats/{name}/{kind}"] = _statistic(kind, values, 3)
    return pa.table(columns)


def _statistic(kind: str, values: Sequence[Any], axes: int) -> pa.Array:
    return nested_column(values, 1, "int64") if kind == "count" else nested_column(values, axes)


def _integers(values: Sequence[int]) -> pa.Array:
    return to_arrow(np.array(values, dtype=np.int64)[:, None])


def _times(values: Sequence[float]) -> pa.Array:
    return to_arrow(np.array(values, dtype=np.float64)[:, None])


def _text_lists(lists: Sequence[Sequence[str]]) -> pa.Array:
    texts = to_arrow_text([text for texts in lists for text in texts])
    ends = np.cumsum([0, *map(len, lists)], dtype=np.int32)
    return pa.ListArray.from_arrays(to_arrow(ends[:, None]), texts)
