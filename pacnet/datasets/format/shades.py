"""Statistics of pictures, of each channel from 0 to 1, as LeRobot's policies normalise by them.

They are exact for the pictures that are counted: each channel has 256 shades.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacnet.datasets.format.statistics import QUANTILES

MOMENTS = ("min", "max", "mean", "std")
_SHADES = 256

Found = dict[str, NDArray[Any]]
"""Statistic -> its values `[C, 1, 1]`; the count is `[1]`."""


class Shades:
    """Counts the shades of red, green and blue in pictures."""

    def __init__(self) -> None:
        """Begin with no picture."""
        self._counts = np.zeros((3, _SHADES), np.int64)
        self._pictures = 0

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Count the shades of a picture `[H, W, 3]`."""
        self._pictures += 1
        for channel, counts in enumerate(self._counts):
            counts += np.bincount(picture[..., channel].ravel(), minlength=_SHADES)

    def statistics(self) -> Found:
        """Return the statistics of all pictures, at least one."""
        levels, total = np.arange(_SHADES) / (_SHADES - 1), self._counts[0].sum()
        mean = self._counts @ levels / total
        spread = np.square(levels - mean[:, None])
        found = {
            "min": self._levels(0),
            "max": self._levels(total - 1),
            "mean": mean,
            "std": np.sqrt((self._counts * spread).sum(axis=1) / total),
        }
        for name, share in QUANTILES.items():
            place = share * (total - 1)
            low, high = self._levels(np.floor(place)), self._levels(np.ceil(place))
            found[name] = low + (high - low) * (place - np.floor(place))
        shaped = {name: values.reshape(3, 1, 1) for name, values in found.items()}
        return shaped | {"count": np.array([self._pictures])}

    def _levels(self, place: float) -> NDArray[np.float64]:
        """Return the level at a place in the order of all, counted from 0, of each channel."""
        ends = np.cumsum(self._counts, axis=1)
        found = [np.searchsorted(counts, place, side="right") for counts in ends]
        return np.array(found) / (_SHADES - 1)


def joined(parts: Sequence[Found]) -> Found:
    """Return the statistics of several episodes; quantiles are averaged, as LeRobot does."""
    counts = np.stack([part["count"] for part in parts])[..., None, None]  # [E, 1, 1, 1]
    weights = counts / counts.sum()
    stacked = {
        kind: np.stack([part[kind] for part in parts])
        for kind in (*MOMENTS, *QUANTILES)
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


def checked(name: str, stored: object, n_frames: int) -> Found | None:
    """Return statistics as arrays, or None if they cannot be those of pictures.

    Format v2.0 has no count; LeRobot needs one to append to them.
    """
    if not isinstance(stored, Mapping):
        return None
    found = {kind: stored.get(kind) for kind in (*MOMENTS, *QUANTILES)}
    arrays = {kind: _array(values) for kind, values in found.items() if values is not None}
    shapes = {values.shape for values in arrays.values()}
    shape = next(iter(shapes)) if len(shapes) == 1 else ()
    if len(shape) != 3 or shape[1:] != (1, 1) or not {*MOMENTS} <= {*arrays}:
        return None
    if "image" in name and shape != (3, 1, 1):  # LeRobot would refuse to append
        return None
    low, high, mean, std = (arrays[kind] for kind in MOMENTS)
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
