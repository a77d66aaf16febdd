"""Statistics of a dataset's features in float64, under LeRobot's names.

LeRobot's own standard deviations are float32 means of squares minus squares of means, which cancel:
0.098 around 1000 comes out as 0.35. These take a second pass, over the deviations from the mean.
"""

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
NAMES = ("min", "max", "mean", "std", "count", *QUANTILES)
_HELD = 2**18  # numbers made float64 at once, where that is not less than one dimension: 2 MB


def statistics(rows: NDArray[np.generic]) -> dict[str, list[float]]:
    """Minimum, maximum, mean, standard deviation, count and quantiles of each dimension.

    Args:
        rows: Values of any dtype, [N > 0, D].

    Returns:
        Name -> one number for each of the D dimensions; of the count there is one in all.
    """
    width = max(1, _HELD // len(rows))  # dimensions at once
    parts = [_of_dimensions(rows[:, at : at + width].T) for at in range(0, rows.shape[1], width)]
    found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    found["count"] = np.array([len(rows)])
    return {name: found[name].tolist() for name in NAMES}


def _of_dimensions(columns: NDArray[np.generic]) -> dict[str, NDArray[np.float64]]:
    """All but the count, of dimensions [D, N]."""
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
