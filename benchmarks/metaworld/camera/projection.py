"""Where in a picture a point in space is seen, by a pinhole camera that is turned upside down."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.metaworld.features import Array


class Pinhole(NamedTuple):
    """A camera of square pixels, whose picture is turned by 180° after it was taken."""

    position: Array
    """`[3]` [m]."""
    axes: Array
    """`[3, 3]`, whose columns point right, up, and backwards."""
    fovy: float
    """Vertical field of view [degrees]."""
    side: int
    """Of the picture [pixels]."""

    def pixel_of(self, points: Array) -> Array:
        """Return rows and columns `[..., 2]`, from the upper left corner, of points `[..., 3]`."""
        right, up, back = np.moveaxis((points - self.position) @ self.axes, -1, 0)
        focal = self.side / 2 / np.tan(np.radians(self.fovy) / 2)
        seen = focal * np.stack([up, -right], axis=-1) / -back[..., None]
        return self.side / 2 + seen
