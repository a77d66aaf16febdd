"""A picture of the scene without OpenGL: the outlines of its convex geoms, from far to near.

The projection of a convex shape is the convex hull of its projected surface points, so one routine
draws spheres, capsules, ellipsoids, cylinders and boxes. Pillow fills the outlines.
"""

import numpy as np
from dm_control import mujoco as dm_mujoco
from mujoco import mjtGeom  # pyright: ignore[reportAttributeAccessIssue]
from PIL import Image, ImageDraw
from scipy.spatial import ConvexHull

from envs.pinhole import NEAREST, Pinhole
from envs.scene import CAMERA, FLOOR_HALF_SIZE, FURNITURE_GROUP, HIDDEN_GROUP

OVERSAMPLING = 2  # pictures are drawn larger and scaled down, for smooth edges
SKY_TOP, SKY_HORIZON, FLOOR = (190, 202, 217), (233, 236, 240), (150, 150, 152)
OUTLINE_SHADE = 0.72


def draw_scene(
    physics: dm_mujoco.Physics, height: int, width: int, camera: str = CAMERA
) -> np.ndarray:
    """Draw the scene as a camera sees it.

    Args:
        physics: The compiled scene in its current state.
        height: Of the picture [pixels].
        width: Of the picture [pixels].
        camera: Its name.

    Returns:
        The picture `[height, width, 3]` uint8.
    """
    size = (height * OVERSAMPLING, width * OVERSAMPLING)
    view = Pinhole(physics, camera, *size)
    picture = _background(view, *size)
    draw = ImageDraw.Draw(picture, "RGBA")
    for geom in _drawing_order(physics, view):
        points = _surface(physics, geom)
        pixels = view.project(points[view.depth(points) >= NEAREST])
        if len(pixels) < 3 or (pixels.max(0) < 0).any() or (pixels.min(0) > size[::-1]).any():
            continue
        outline = pixels[ConvexHull(pixels).vertices].ravel().tolist()
        red, green, blue, alpha = physics.model.geom_rgba[geom]
        fill = tuple(round(255 * float(c)) for c in (red, green, blue, alpha))
        edge = tuple(round(OUTLINE_SHADE * c) for c in fill[:3])
        draw.polygon(outline, fill=fill, outline=edge)
    return np.asarray(picture.resize((width, height), Image.Resampling.BOX))


def _background(camera: Pinhole, height: int, width: int) -> Image.Image:
    """Return a graded sky above the floor's far edge, and the floor's colour below it."""
    edge = FLOOR_HALF_SIZE * camera.heading
    horizon = int(np.clip(camera.project(edge[None])[0, 1], 0, height))
    rows = np.empty((height, 1, 3), dtype=np.uint8)
    rows[:horizon, 0] = np.linspace(SKY_TOP, SKY_HORIZON, horizon)
    rows[horizon:, 0] = FLOOR
    return Image.fromarray(np.repeat(rows, width, axis=1))


def _drawing_order(physics: dm_mujoco.Physics, camera: Pinhole) -> np.ndarray:
    """Return visible geoms: furniture first, which is below all else, then from far to near."""
    model = physics.model
    visible = (model.geom_group < HIDDEN_GROUP) & (model.geom_type != mjtGeom.mjGEOM_PLANE)
    geoms = np.flatnonzero(visible)
    geoms = geoms[camera.sees(physics.data.geom_xpos[geoms], model.geom_rbound[geoms])]
    depth = camera.depth(physics.data.geom_xpos[geoms])
    is_above = model.geom_group[geoms] != FURNITURE_GROUP
    return geoms[np.lexsort((-depth, is_above))]


def _surface(physics: dm_mujoco.Physics, geom: int) -> np.ndarray:
    """Return points `[N, 3]` [m] in the world whose convex hull is a geom."""
    kind, size = physics.model.geom_type[geom], physics.model.geom_size[geom]
    points = _local_surface(kind, size)
    return physics.data.geom_xpos[geom] + points @ physics.data.geom_xmat[geom].reshape(3, 3).T


def _local_surface(kind: int, size: np.ndarray) -> np.ndarray:
    """Return surface points `[N, 3]` [m] of MuJoCo's `kind` and `size`, in the geom's frame."""
    if kind == mjtGeom.mjGEOM_BOX:
        return _CUBE * size
    if kind in _ROUND:
        round_end, end = _ROUND[kind]
        return round_end * size[0] + end * size[1]
    return _SPHERE * (size if kind == mjtGeom.mjGEOM_ELLIPSOID else size[0])


def _unit_sphere(n_rings: int = 13, n_around: int = 24) -> np.ndarray:
    """Return points `[N, 3]` on the unit sphere."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, n_rings), np.linspace(0, 2 * np.pi, n_around, endpoint=False)
    )
    polar, around = polar.ravel(), around.ravel()
    sine = np.sin(polar)
    return np.stack([sine * np.cos(around), sine * np.sin(around), np.cos(polar)], axis=1)


_SPHERE = np.unique(_unit_sphere().round(12), axis=0)  # each pole once
_AROUND = np.arange(24) / 12 * np.pi  # the same after half a turn, as the scene is
_CIRCLE = np.stack([np.cos(_AROUND), np.sin(_AROUND), np.zeros(24)], axis=1)
_CUBE = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BOWL = _SPHERE[_SPHERE[:, 2] <= 0]
_CAPSULE = np.concatenate([_BOWL, _BOWL * (1, 1, -1)])
_CYLINDER = np.tile(_CIRCLE, (2, 1))
# Kind -> points for a radius of one, and to which end each belongs.
_ROUND = {
    int(kind): (points, np.repeat([-1.0, 1.0], len(points) // 2)[:, None] * (0.0, 0.0, 1.0))
    for kind, points in ((mjtGeom.mjGEOM_CAPSULE, _CAPSULE), (mjtGeom.mjGEOM_CYLINDER, _CYLINDER))
}
