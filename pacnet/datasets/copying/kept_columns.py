"""Which features of a dataset's data files a copy keeps: those that LeRobot can hold.

LeRobot casts each column to the dtype and the shape that `meta/info.json` declares, and makes a
tensor of every value that is no text. What cannot be cast is left out, with the reason.
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import types

from pacnet.datasets.copying.source import Source
from pacnet.datasets.format.features import INDEX_COLUMNS, RESERVED
from pacnet.datasets.format.parquet import is_list, open_parquet

_NUMBERS = re.compile(r"float(16|32|64)|u?int(8|16|32|64)|bool")
_MAX_AXES = 5  # of a matrix


class Kept(NamedTuple):
    """The features of a copy, but videos.

    Attributes:
        features: feature -> its description.
        left_out: feature or column -> why it is left out.
    """

    features: dict[str, dict[str, Any]]
    left_out: dict[str, str]

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of each feature of numbers."""
        return {
            name: tuple(entry["shape"])
            for name, entry in self.features.items()
            if _NUMBERS.fullmatch(entry["dtype"])
        }


def kept_columns(source: Source) -> Kept:
    """Return which features of the source's data files are kept, and which are not; reads none."""
    kept, left_out = {}, {}
    for name, entry in source.info["features"].items():
        if name in INDEX_COLUMNS or (isinstance(entry, dict) and entry.get("dtype") == "video"):
            continue
        description = _described(entry)
        reason = _unfit_description(name, description)
        if reason:
            left_out[name] = reason
        else:
            kept[name] = description
    for path in source.data_files:
        with open_parquet(path) as file:
            _check_file(path, file, kept, left_out)
            for name in file.schema_arrow.names:
                if name not in (*source.info["features"], *INDEX_COLUMNS):
                    left_out[name] = "it is not declared in meta/info.json"
    return Kept(kept, left_out)


def _described(entry: Any) -> Any:
    """Return a feature's description with what LeRobot expects in each: names, one dimension."""
    if not isinstance(entry, dict):
        return entry
    shape = [1] if entry.get("shape") == [] else entry.get("shape")
    return {"dtype": None, "names": None} | entry | {"shape": shape}


def _unfit_description(name: str, entry: Any) -> str | None:
    """Return why LeRobot cannot hold a feature with this description, or None."""
    if name in RESERVED or "/" in name or not name:
        return "LeRobot reserves this name"
    dtype, shape = (entry["dtype"], entry["shape"]) if isinstance(entry, dict) else (None, None)
    if not isinstance(dtype, str) or not _is_shape(shape):
        return f"its description is {str(entry)[:200]}"
    if dtype == "image":
        return None if len(shape) == 3 else f"it is an image of shape {shape}"
    if dtype == "string":
        return None if shape == [1] else "LeRobot cannot read several texts in a frame"
    if not _NUMBERS.fullmatch(dtype) or not 0 < len(shape) <= _MAX_AXES:
        return f"LeRobot has no dtype {dtype} of shape {shape}"
    return None


def _is_shape(shape: object) -> TypeGuard[list[int]]:
    return isinstance(shape, list) and all(type(size) is int and size > 0 for size in shape)


def _check_file(
    path: Path, file: pq.ParquetFile, kept: dict[str, dict[str, Any]], left_out: dict[str, str]
) -> None:
    """Move the features that a file does not have as they are declared to those left out."""
    schema = file.schema_arrow
    for name in [*kept]:
        if name not in schema.names:
            reason = f"{path} does not have it"
        else:
            reason = _unfit_column(schema.field(name).type, kept[name], _counts(file, name))
            reason = reason and f"{path} has {reason}"
        if reason:
            del kept[name]
            left_out[name] = reason


def _unfit_column(
    kind: pa.DataType, entry: Mapping[str, Any], counts: Mapping[str, int]
) -> str | None:
    """Return what a column holds in place of what is declared, or None if LeRobot can cast it."""
    dtype, shape = entry["dtype"], entry["shape"]
    if isinstance(kind, pa.BaseExtensionType):
        kind = kind.storage_type
    if counts["gaps"]:
        return f"{counts['gaps']} gaps"
    if dtype == "image":
        encoded = types.is_struct(kind) and kind.get_field_index("bytes") >= 0
        return None if encoded or types.is_binary(kind) else f"{kind} in place of encoded images"
    axes = 0
    while is_list(kind):
        kind, axes = kind.value_type, axes + 1
    if not _is_kind(kind, dtype):
        return f"{kind} in place of {dtype}"
    if axes != len(shape) and (axes, shape) != (0, [1]):
        return f"{axes} axes in place of shape {shape}"
    if dtype != "string" and counts["values"] != counts["rows"] * math.prod(shape):
        return f"{counts['values']} values in {counts['rows']} frames in place of shape {shape}"
    return None


def _is_kind(kind: pa.DataType, dtype: str) -> bool:
    if dtype == "string":
        return types.is_string(kind) or types.is_large_string(kind)
    if dtype == "bool":
        return types.is_boolean(kind)
    if dtype.startswith("float"):
        return types.is_floating(kind)
    return types.is_integer(kind)


def _counts(file: pq.ParquetFile, name: str) -> dict[str, int]:
    """Return the rows, values and gaps of a column; of an image's file, those of its bytes."""
    rows = values = gaps = 0
    for group in map(file.metadata.row_group, range(file.metadata.num_row_groups)):
        for column in _columns(group, name):
            rows, values = rows + group.num_rows, values + column.num_values
            if column.statistics is not None and column.statistics.has_null_count:
                gaps += column.statistics.null_count
    return {"rows": rows, "values": values, "gaps": gaps}


def _columns(group: pq.RowGroupMetaData, name: str) -> Iterator[pq.ColumnChunkMetaData]:
    for column in map(group.column, range(group.num_columns)):
        path = column.path_in_schema
        if path in (name, f"{name}.bytes") or path.startswith(f"{name}.list."):
            yield column
