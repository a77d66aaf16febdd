"""The walled arena as a MuJoCo model: floor, walls, islands, learner, optionally teacher."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement, tostring

from envs.arena import THICKNESS, Arena, Box, Pillar
from envs.khepera import add_robot

TIMESTEP = 0.01  # [s] of the physics
CONTROL_TIMESTEP = 0.1  # [s]
N_SUBSTEPS = round(CONTROL_TIMESTEP / TIMESTEP)
WALL_HEIGHT = 0.05  # [m]
TOP_CAMERA, CHASE_CAMERA = "top", "chase"
TOP_CAMERA_HEIGHT = 4.0  # [m] high enough to see nearly no walls from the side
AMBIENT, DIFFUSE = 0.55, 0.45  # of the light, which shines from the camera
MAX_WIDTH, MAX_HEIGHT = 1920, 1080  # [pixels] of a picture

SKY = (0.97, 0.97, 0.98)
WALL, ISLAND, FLOOR = (0.30, 0.32, 0.37, 1.0), (0.44, 0.60, 0.54, 1.0), (0.87, 0.87, 0.85, 1.0)


def build_scene(arena: Arena, robots: tuple[str, ...]) -> str:
    """Return the model as XML.

    Args:
        arena: To build.
        robots: "learner", and "teacher" if there is one.
    """
    root = Element("mujoco", model="walled arena")
    SubElement(root, "option", timestep=str(TIMESTEP), integrator="implicit")
    SubElement(root, "compiler", autolimits="true", angle="radian")
    _add_visuals(root, arena)
    _add_sky(root)
    world = SubElement(root, "worldbody")
    _add_surroundings(world, arena)
    actuators, sensors = SubElement(root, "actuator"), SubElement(root, "sensor")
    for name in robots:
        add_robot(world, actuators, sensors, name)
    _add_chase_camera(world)
    return tostring(root, encoding="unicode")


def _add_visuals(root: Element, arena: Arena) -> None:
    SubElement(root, "statistic", extent=str(max(arena.size)), center="0 0 0")
    visual = SubElement(root, "visual")
    SubElement(visual, "global", offwidth=str(MAX_WIDTH), offheight=str(MAX_HEIGHT))
    SubElement(visual, "quality", shadowsize="0")
    SubElement(
        visual, "headlight", ambient=_text([AMBIENT] * 3), diffuse=_text([DIFFUSE] * 3),
        specular="0 0 0",
    )  # fmt: skip
    SubElement(visual, "map", znear="0.01", zfar="20")


def _add_sky(root: Element) -> None:
    sky = {"type": "skybox", "builtin": "flat", "width": "8", "height": "8"}
    colours = {"rgb1": _text(SKY), "rgb2": _text(SKY)}
    SubElement(SubElement(root, "asset"), "texture", {**sky, **colours})


def _add_surroundings(world: Element, arena: Arena) -> None:
    half_x, half_y = arena.size[0] / 2 + THICKNESS, arena.size[1] / 2 + THICKNESS
    SubElement(
        world, "geom", name="floor", type="plane", size=f"{half_x} {half_y} 0.1",
        rgba=_text(FLOOR), contype="0", conaffinity="0",
    )  # fmt: skip
    SubElement(
        world, "camera", name=TOP_CAMERA, pos=f"0 0 {TOP_CAMERA_HEIGHT}", xyaxes="1 0 0 0 1 0"
    )
    walls = [(wall, WALL) for wall in (*arena.outer_walls, *arena.inner_walls)]
    for number, (obstacle, colour) in enumerate(walls + [(i, ISLAND) for i in arena.islands]):
        look = {"name": f"obstacle_{number}", "rgba": _text(colour)}
        SubElement(world, "geom", {**look, **_shape(obstacle)}, friction="0.05")


def _shape(obstacle: Box | Pillar) -> dict[str, str]:
    x, y = obstacle.centre
    place = f"{x} {y} {WALL_HEIGHT / 2}"
    if isinstance(obstacle, Pillar):
        size = f"{obstacle.radius} {WALL_HEIGHT / 2}"
        return {"type": "cylinder", "pos": place, "size": size}
    half_x, half_y = obstacle.half_size
    size = f"{half_x} {half_y} {WALL_HEIGHT / 2}"
    return {"type": "box", "pos": place, "size": size, "euler": f"0 0 {obstacle.angle}"}


def _text(numbers: Iterable[float]) -> str:
    return " ".join(map(str, numbers))


def _add_chase_camera(world: Element) -> None:
    learner = world.find("body[@name='learner']")
    assert learner is not None
    SubElement(
        learner, "camera", name=CHASE_CAMERA, pos="-0.24 0 0.24", xyaxes="0 -1 0 0.6 0 0.8",
        fovy="55",
    )  # fmt: skip
