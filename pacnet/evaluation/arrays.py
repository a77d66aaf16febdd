"""Checks of the arrays that metrics and figures are given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def finite_array(name: str, value: ArrayLike, shape: tuple[int | str, ...]) -> NDArray[np.float64]:
    """Return a finite float64 copy of `value`.

    Args:
        name: what it is, for the error message.
        value: integers or floats.
        shape: length along each axis; a letter stands for any length.

    Raises:
        ValueError: other types, another shape, NaN or infinity.
    """
    array = np.asarray(value)
    fits = array.ndim == len(shape) and all(
        isinstance(wanted, str) or size == wanted
        for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits or array.dtype.kind not in "fiu":
        wanted = ", ".join(map(str, shape))
        raise ValueError(f"expected {name} as numbers [{wanted}], got {array.dtype} {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"expected finite {name}, got NaN or infinity")
    return array.astype(np.float64)


def integer_series(name: str, value: ArrayLike) -> NDArray[np.int64]:
    """Return `value` as int64 `[T]`; T may be 0.

    Raises:
        ValueError: anything but integers `[T]`.
    """
    array = np.asarray(value)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(f"expected {name} as integers [T], got {array.dtype} {array.shape}")
    return array.astype(np.int64)
