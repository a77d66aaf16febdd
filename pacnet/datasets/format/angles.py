"""Angles that jump by a full turn."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def find_wraps(
    values: Sequence[NDArray[np.float32]],  # noqa: ARG001
    episodes: Sequence[int],  # noqa: ARG001
    names: Sequence[str],  # noqa: ARG001
    fps: float,  # noqa: ARG001
    feature: str,  # noqa: ARG001
) -> list[str]:
    """Return a sentence for each dimension that wraps."""
    return []
