"""Statistics of a dataset's features in float64, under LeRobot's names.

LeRobot computes standard deviations in float32 from the mean of squares, which cancels: 0.098
around 1000 comes out as 0.35. Here a second pass takes the deviations from the mean.
"""

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
NAMES = ("min", "max", "mean", "std", "count", *QUANTILES)
_BLOCK = 2**18  # numbers converted to float64 at once, 2 MB, or one dimension if that is more


def statistics(rows: NDArray[np.generic]) -> dict[str, list[float]]:
    """Return each statistic of values of any dtype, `[N > 0, D]`, as `[D]`; the count as `[1]`."""
    width = max(1, _BLOCK // len(rows))  # dimensions at once
    parts = [_of_dimensions(rows[:, at : at + width].T) for at in range(0, rows.shape[1], width)]
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    found["count"] = np.array([len(rows)])
    return {name: found[name].tolist() for name in NAMES}


def _of_dimensions(columns: NDArray[np.generic]) -> dict[str, NDArray[np.float64]]:
    """Return all but the count, from dimensions `[D, N]`."""
    values = columns.astype(np.float64, order="C")
    mean = values.mean(axis=1)
    found = {
        "min": values.min(axis=1),
        "max": values.max(axis=1),
        "mean": mean,
        "std": np.sqrt(np.square(values - mean[:, None]).mean(axis=1)),
    }
    quantiles = np.quantile(values, [*QUANTILES.values()], axis=1, overwrite_input=True)
    return found | dict(zip(QUANTILES, quantiles, strict=True))
