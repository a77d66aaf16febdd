"""The episode that is being recorded frame by frame, until it is saved or dropped."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pacnet.datasets.format.features import Feature, checked_frame


class EpisodeBuffer:
    """The frames added so far, in memory alone."""

    def __init__(self, features: Mapping[str, Feature]) -> None:
        """A buffer without frames.

        Args:
            features: Feature name -> what it holds.
        """
        self._features = features
        self._frames: list[dict[str, NDArray[np.generic]]] = []  # of vectors [D]

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._frames)

    def add(self, frame: Mapping[str, ArrayLike]) -> None:
        """Append a frame.

        Raises:
            ValueError: As `checked_frame`; the message says which frame it would have been.
        """
        try:
            checked = checked_frame(self._features, frame)
        except ValueError as error:
            raise ValueError(f"frame {len(self)}: {error}") from None
        self._frames.append(checked)

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Feature name -> its values, [T, D] of the feature's dtype.

        Raises:
            ValueError: There is no frame.
        """
        if not self._frames:
            raise ValueError("expected frames, given here or added before, got none")
        return {name: np.stack([frame[name] for frame in self._frames]) for name in self._features}

    def clear(self) -> None:
        """Drop all frames."""
        self._frames = []
