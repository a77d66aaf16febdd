"""Statistics of a dataset's features in float64, under LeRobot's names.

LeRobot's own standard deviations are float32 means of squares minus squares of means, which cancel:
0.098 around 1000 comes out as 0.35. These take a second pass, over the deviations from the mean.
"""

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
NAMES = ("min", "max", "mean", "std", "count", *QUANTILES)


def statistics(rows: NDArray[np.generic]) -> dict[str, list[float]]:
    """Minimum, maximum, mean, standard deviation, count and quantiles of each dimension.

    Args:
        rows: Values of any dtype, [N > 0, D].

    Returns:
        Name -> one number for each of the D dimensions; of the count there is one in all.
    """
    values = rows.astype(np.float64)
    mean = values.mean(axis=0)
    found = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": mean,
        "std": np.sqrt(np.square(values - mean).mean(axis=0)),
        "count": np.array([len(values)]),
    }
    found |= dict(zip(QUANTILES, np.quantile(values, [*QUANTILES.values()], axis=0), strict=True))
    return {name: found[name].tolist() for name in NAMES}
