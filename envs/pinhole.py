"""A camera of a scene as a pinhole: world points to pixels, and pixels to lines of sight."""

import numpy as np
from dm_control import mujoco

NEAREST = 0.05  # [m] from the camera, of what is seen


class Pinhole:
    """A perspective camera and a picture of a given size.

    Args:
        physics: The compiled scene in its current state.
        camera: Its name.
        height: Of the picture [pixels].
        width: Of the picture [pixels].
    """

    def __init__(self, physics: mujoco.Physics, camera: str, height: int, width: int) -> None:
        index = physics.model.name2id(camera, "camera")
        self.position = physics.data.cam_xpos[index].copy()  # [3] [m]
        self._axes = physics.data.cam_xmat[index].reshape(3, 3).copy()  # columns: right, up, back
        self._focal = height / 2 / np.tan(np.deg2rad(physics.model.cam_fovy[index]) / 2)
        self._centre = np.array([width / 2, height / 2])
        self._size = (height, width)

    @property
    def heading(self) -> np.ndarray:
        """Return where it looks `[3]`, a horizontal unit vector."""
        forwards = self._axes[:, 2] * (-1.0, -1.0, 0.0)
        return forwards / np.linalg.norm(forwards)

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Return the distances `[N]` [m] of points `[N, 3]` along the line of sight."""
        return -(points - self.position) @ self._axes[:, 2]

    def sees(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Return which balls may be in the picture, bool `[N]`: none that is not is left out.

        Args:
            centres: Of the balls `[N, 3]` [m].
            radii: Of the balls `[N]` [m].
        """
        seen = (centres - self.position) @ self._axes
        slopes = self._centre / self._focal  # of the picture's sides and of its top and bottom
        beyond = np.abs(seen[:, :2]) + seen[:, 2:] * slopes  # of a side, times a cosine
        near = beyond <= radii[:, None] * np.hypot(1.0, slopes)
        return (seen[:, 2] < radii - NEAREST) & near.all(axis=1)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return pixels `[N, 2]`, column and row, of points `[N, 3]` [m] in front of the camera."""
        seen = (points - self.position) @ self._axes
        return self._centre + self._focal * seen[:, :2] * (1, -1) / -seen[:, 2:]

    def lines_of_sight(self) -> np.ndarray:
        """Return unit vectors from the camera through the middle of each pixel `[H, W, 3]`."""
        height, width = self._size
        columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        right, down = columns - self._centre[0], rows - self._centre[1]
        seen = np.stack([right, -down, np.full_like(right, -self._focal)], axis=-1)
        return seen / np.linalg.norm(seen, axis=-1, keepdims=True) @ self._axes.T
