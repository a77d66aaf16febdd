"""The features of a dataset that are vectors of numbers: declared, or found in its data."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pyarrow import types

from pacnet.datasets.format import DatasetError, MissingFeature
from pacnet.datasets.format.data_files import columns_of
from pacnet.datasets.format.features import RESERVED
from pacnet.datasets.format.info import image_features
from pacnet.datasets.format.parquet import is_list


def check_vectors(root: Path, info: dict[str, Any], features: Sequence[str]) -> None:
    """Raise an error unless these features are declared as vectors, or are some in the data.

    Raises:
        MissingFeature: there are none of these names.
        DatasetError: one is something else.
    """
    undeclared = [name for name in features if name not in info["features"]]
    if undeclared:
        columns = columns_of(root)
        missing = tuple(name for name in undeclared if name not in columns)
        if missing:
            raise missing_features(root, info, missing)
    for name in set(features) - set(undeclared):
        _check_declared(info, name)


def vector_columns(root: Path, info: dict[str, Any]) -> list[str]:
    """Return the columns of the data that are vectors of numbers, without those of the format."""
    columns, images = columns_of(root), image_features(info)
    return [
        name
        for name, kind in columns.items()
        if _is_vector(kind) and name not in RESERVED and name not in images
    ]


def missing_features(root: Path, info: dict[str, Any], missing: tuple[str, ...]) -> MissingFeature:
    """Return the error that these features are not there, with the vectors that are."""
    vectors = ", ".join(f"{name!r}{_size(info, name)}" for name in vector_columns(root, info))
    wanted = " and ".join(map(repr, missing))
    noun = "feature" if len(missing) == 1 else "features"
    there = f"the vectors {vectors}" if vectors else "no vectors of numbers"
    return MissingFeature(f"expected the {noun} {wanted}, the dataset has {there}", missing)


def _check_declared(info: dict[str, Any], name: str) -> None:
    entry = info["features"][name]
    expected = f"expected {name!r} to be a vector of numbers of shape [D > 0]"
    if not isinstance(entry, dict):
        raise DatasetError(f"{expected}, found the description {entry!r}")
    dtype, shape = entry.get("dtype"), entry.get("shape")
    if name in image_features(info):
        raise DatasetError(
            f"{expected}, found {dtype}s of shape {shape}: pictures are read by "
            f"load_demonstrations(..., cameras=[{name!r}])"
        )
    is_vector = isinstance(shape, list) and [*map(type, shape)] == [int] and shape[0] > 0
    if not is_vector or not re.match("float|u?int|bool", str(dtype)):
        raise DatasetError(f"{expected}, found dtype {dtype}, shape {shape}")


def _is_vector(kind: Any) -> bool:
    if is_list(kind):
        kind = kind.value_type
    return types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)


def _size(info: dict[str, Any], name: str) -> str:
    """Return a vector's length in brackets, where it is declared."""
    entry = info["features"].get(name)
    shape = entry.get("shape") if isinstance(entry, dict) else None
    return f" [{shape[0]}]" if isinstance(shape, list) and len(shape) == 1 else ""
