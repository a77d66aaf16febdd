"""Pictures of the arena, from above or behind the learner, with the rays of its sensors.

OpenGL draws them if it is available. Otherwise MuJoCo finds what each pixel's line of sight hits,
and Pillow draws the rays over it, with the same cameras, colours and light.
"""

from __future__ import annotations

import numpy as np
from dm_control import mujoco
from dm_control.mujoco import wrapper
from mujoco import mj_multiRay, mjtGeom, mjv_connector, mjv_initGeom  # pyright: ignore[reportAttributeAccessIssue]
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from envs.arena_physics import ArenaPhysics
from envs.arena_scene import AMBIENT, DIFFUSE, SKY, TOP_CAMERA, TOP_CAMERA_HEIGHT, WALL_HEIGHT
from envs.khepera import HEIGHT, INFRARED_NAMES, RAY_ANGLES, REACH
from envs.pinhole import Pinhole

RAY_FAR, RAY_NEAR = (0.66, 0.62, 0.72), (0.78, 0.0, 0.45)  # of a sensor that reads 0, and 1
MARGIN = 0.03  # [m] around the arena as seen from above
_LINES_PER_WIDTH = 180  # rays are drawn 1/180 of the picture's height wide


def render_arena(physics: ArenaPhysics, camera: str, height: int, width: int) -> NDArray[np.uint8]:
    """Draw the arena with OpenGL.

    Args:
        physics: The arena in its current state.
        camera: "top" or "chase".
        height: Of the picture [pixels].
        width: Of the picture [pixels].

    Returns:
        The picture `[height, width, 3]` uint8.

    Raises:
        Exception: OpenGL is not available; each backend raises its own kind.
    """
    _fit_top_camera(physics, height, width)
    starts, ends, colours = _rays(physics)

    def add_rays(_physics: mujoco.Physics, scene: wrapper.MjvScene) -> None:
        scene.ptr.ngeom += len(starts)
        lines = scene.ptr.geoms[-len(starts) :]
        for line, start, end, colour in zip(lines, starts, ends, colours, strict=True):
            mjv_initGeom(
                line, mjtGeom.mjGEOM_LINE, np.zeros(3), np.zeros(3), np.eye(3).ravel(),
                np.array([*colour, 1.0], dtype=np.float32),
            )  # fmt: skip
            mjv_connector(line, mjtGeom.mjGEOM_LINE, _line_width(height), start, end)
            line.emission = 1.0  # a line has no surface to light

    index = physics.model.name2id(camera, "camera")
    return physics.render(height, width, camera_id=index, scene_callback=add_rays)


def draw_arena(physics: ArenaPhysics, camera: str, height: int, width: int) -> NDArray[np.uint8]:
    """Draw the arena without OpenGL.

    Args:
        physics: The arena in its current state.
        camera: "top" or "chase".
        height: Of the picture [pixels].
        width: Of the picture [pixels].

    Returns:
        The picture `[height, width, 3]` uint8.
    """
    _fit_top_camera(physics, height, width)
    pinhole = Pinhole(physics, camera, height, width)
    picture = Image.fromarray(_lit_colours(physics, pinhole))
    draw = ImageDraw.Draw(picture)
    for start, end, colour in zip(*_rays(physics), strict=True):
        line = pinhole.project(np.stack([start, end]))
        fill = tuple(round(255 * float(c)) for c in colour)
        draw.line(line.ravel().tolist(), fill=fill, width=round(_line_width(height)))
    return np.asarray(picture)


def _lit_colours(physics: ArenaPhysics, pinhole: Pinhole) -> NDArray[np.uint8]:
    """Return the colour that each pixel sees `[H, W, 3]`, lit from the camera."""
    sight = pinhole.lines_of_sight()
    count = sight[..., 0].size
    geoms, distances = np.empty(count, dtype=np.int32), np.empty(count)
    normals = np.empty(3 * count)
    mj_multiRay(
        physics.model.ptr, physics.data.ptr, pinhole.position, sight.ravel(), None, True, -1,
        geoms, distances, normals, count, np.inf,
    )  # fmt: skip
    facing = np.abs((normals.reshape(sight.shape) * sight).sum(axis=-1, keepdims=True))
    geoms = geoms.reshape(sight.shape[:2])
    colours = physics.model.geom_rgba[geoms, :3] * (AMBIENT + DIFFUSE * facing)
    seen = np.where(geoms[..., None] < 0, SKY, colours)
    return np.round(255 * np.clip(seen, 0, 1)).astype(np.uint8)


def _rays(physics: ArenaPhysics) -> tuple[NDArray[np.float64], ...]:
    """Return start and end points `[18, 3]` [m] of the learner's rays, and their colours `[18, 3]`.

    They are drawn at the height of the robot's top, where its hull does not hide them.
    """
    count = len(INFRARED_NAMES) * len(RAY_ANGLES)
    sites = physics.model.sensor_objid[:count]
    directions = physics.data.site_xmat[sites].reshape(-1, 3, 3)[:, :, 2]
    distances = physics.data.sensordata[:count]
    lengths = np.where((distances < 0) | (distances > REACH), REACH, distances)
    starts = physics.data.site_xpos[sites] + (0.0, 0.0, HEIGHT / 2)
    readings = np.repeat(physics.infrared(0), len(RAY_ANGLES))[:, None]
    colours = (1 - readings) * RAY_FAR + readings * RAY_NEAR
    return starts, starts + lengths[:, None] * directions, colours


def _fit_top_camera(physics: ArenaPhysics, height: int, width: int) -> None:
    """Set the top camera's angle so that the arena fits a picture of this shape."""
    x, y = (side / 2 + MARGIN for side in physics.arena.size)
    half = max(y, x * height / width)  # [m] of the picture's height
    angle = 2 * np.arctan(half / (TOP_CAMERA_HEIGHT - WALL_HEIGHT))
    camera = physics.model.name2id(TOP_CAMERA, "camera")
    physics.model.cam_fovy[camera] = np.rad2deg(angle)


def _line_width(height: int) -> float:
    """Return the width of a ray [pixels]."""
    return max(1.0, height / _LINES_PER_WIDTH)
