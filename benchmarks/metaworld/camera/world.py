"""A task of Metaworld through the camera that LeRobot's environment of it has.

LeRobot moves the camera `corner2` and turns its picture by 180°. It takes 480 × 480 pixels with
shadows; here it is 128 × 128 without, which a CPU draws 20 times as fast. The marks that Metaworld
draws where things shall go are in the picture, as they are for LeRobot's policies.
"""

from __future__ import annotations

import importlib
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.metaworld.camera.projection import Pinhole
from benchmarks.metaworld.simulation import World

SIDE = 128  # of a picture [pixels]
CAMERA = "corner2"
POSITION = (0.75, 0.075, 0.7)  # of the camera [m]
HIDDEN = 5  # a group of shapes that is not drawn
ROBOT_ENDS = "mocap"  # the last body that all tasks have
MARKS = {"drawer-open": ("goal",)}
"""Task -> marks that lie where the object does; they vanish with it."""

Picture = NDArray[np.uint8]  # [SIDE, SIDE, 3]


class SeenWorld(World):
    """A task that can be looked at.

    Args:
        task: its name without a version, as in `tasks`.
        absent: whether what the task brings is invisible, as if it had been taken away. It must
            not be touched then.
    """

    def __init__(self, task: str, *, absent: bool = False) -> None:
        os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported
        os.environ.setdefault("LP_NUM_THREADS", "1")  # of a renderer without a graphics card
        super().__init__(task)
        model = self.env.model
        self._camera = int(model.camera(CAMERA).id)
        model.cam_pos[self._camera] = POSITION
        model.vis.quality.offsamples = 0
        self._renderer: Any = None
        if absent:
            self._hide()

    def picture(self) -> Picture:
        """Return what the camera sees now."""
        import mujoco

        made: Any = mujoco
        if self._renderer is None:
            # Torch's compiler and Mesa each bring an LLVM of their own; loaded in the other order,
            # the process crashes.
            importlib.import_module("torch._dynamo")
            self._renderer = made.Renderer(self.env.model, SIDE, SIDE)
        self._renderer.update_scene(self.env.data, CAMERA)
        for name in ("SHADOW", "REFLECTION", "SKYBOX"):
            self._renderer.scene.flags[getattr(made.mjtRndFlag, f"mjRND_{name}")] = 0
        return self._renderer.render()[::-1, ::-1].copy()

    @property
    def camera(self) -> Pinhole:
        """The camera as it stands."""
        data, model = self.env.data, self.env.model
        axes = data.cam_xmat[self._camera].reshape(3, 3).copy()
        return Pinhole(
            data.cam_xpos[self._camera].copy(), axes, float(model.cam_fovy[self._camera]), SIDE
        )

    def close(self) -> None:
        """Release the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _hide(self) -> None:
        """Make what the task brings invisible."""
        model, last = self.env.model, int(self.env.model.body(ROBOT_ENDS).id)
        model.geom_group[model.geom_bodyid > last] = HIDDEN
        model.site_group[model.site_bodyid > last] = HIDDEN
        for name in MARKS.get(self.task, ()):
            model.site(name).group = HIDDEN
