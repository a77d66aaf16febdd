"""The scene of Experiment 1: two humanoids face to face at a table, each with its own glass.

The scene is symmetric about the vertical through the table's centre, so it is the same in each
body's own frame (origin at its pelvis, x forwards, z up).
"""

import numpy as np
from dm_control import mjcf

from envs import humanoid
from envs.head_camera import add_head_camera
from envs.humanoid import Element

DEMONSTRATOR, IMITATOR = "demonstrator", "imitator"
WHO = (DEMONSTRATOR, IMITATOR)

ROOT_HEIGHT = 1.0  # [m] pelvis above the floor
ROOT_DISTANCE = 1.24  # [m] between the pelves
FLOOR_HALF_SIZE = 4.0  # [m]
TABLE_TOP = 1.15  # [m] above the floor
TABLE_HALF_SIZE = (0.33, 0.52, 0.02)  # [m]
GLASS_PLACE = (0.50, -0.07)  # [m] nominal place, in the body frame
GLASS_RADIUS = 0.036  # [m]
GLASS_HEIGHT = 0.14  # [m]
GLASS_SIDE = 0.85 * GLASS_RADIUS  # [m] half the side of the box as which it collides
GLASS_MASS = 0.35  # [kg]
GRIP_HEIGHT = 0.005  # [m] above the glass's middle, where a hand takes it
GRIP_STRETCH = 0.02  # [m] above and below that, where a hand can take it too
GLASS_REST_Z = TABLE_TOP + GLASS_HEIGHT / 2 - ROOT_HEIGHT  # [m] standing glass, body frame

SHIRTS = {DEMONSTRATOR: (0.16, 0.38, 0.62, 1.0), IMITATOR: (0.80, 0.33, 0.20, 1.0)}
SKINS = {DEMONSTRATOR: (0.93, 0.76, 0.62, 1.0), IMITATOR: (0.78, 0.56, 0.42, 1.0)}
BEER = (0.95, 0.62, 0.08, 0.9)
FOAM = (1.0, 0.98, 0.92, 1.0)
CLEAR = (0.85, 0.92, 0.95, 0.28)
WOOD = (0.50, 0.34, 0.21, 1.0)
STEEL = (0.33, 0.35, 0.38, 1.0)

CAMERA = "side"
CAMERA_POS = (0.0, -2.45, 1.95)  # [m]
CAMERA_TARGET = (0.0, 0.0, 1.34)  # [m]
CAMERA_FOVY = 30.0  # [degrees]
MAX_WIDTH, MAX_HEIGHT = 1920, 1080  # [pixels] of a rendered picture

FURNITURE_GROUP, HIDDEN_GROUP = 1, 3  # of geoms: MuJoCo shows the groups below 3

PHYSICS_TIMESTEP = 0.004  # [s]
N_SUBSTEPS = 5
CONTROL_TIMESTEP = N_SUBSTEPS * PHYSICS_TIMESTEP  # [s]
_NO_CONTACT = {"contype": 0, "conaffinity": 0}


def build_scene() -> Element:
    """Build the whole scene.

    Returns:
        A PyMJCF model; the elements of the two bodies are prefixed by ``demonstrator/`` and
        ``imitator/``, the glasses are ``demonstrator_glass`` and ``imitator_glass``.
    """
    scene: Element = mjcf.RootElement(model="postural_imitation")
    _set_options(scene)
    _add_room(scene)
    _add_table(scene)
    for who, side in ((DEMONSTRATOR, -1.0), (IMITATOR, 1.0)):
        _add_seat(scene, who, side)
        body = humanoid.build_humanoid(who, SHIRTS[who], SKINS[who])
        _place(scene, who, side).attach(body)
        _add_head_camera(scene, who, side)
        _add_glass(scene, who, side)
        _add_grip(scene, who, body)
    _add_actuators(scene)
    return scene


def _set_options(scene: Element) -> None:
    """Set the integrator, the solver and the size and quality of pictures."""
    scene.option.timestep = PHYSICS_TIMESTEP
    scene.option.integrator = "implicitfast"
    scene.option.cone = "elliptic"
    scene.compiler.angle = "radian"
    scene.compiler.fusestatic = True  # welded parts become one body: three times faster
    scene.visual.quality.shadowsize = 0  # shadows are ten times slower in software
    scene.visual.headlight.set_attributes(
        ambient=(0.35, 0.35, 0.35), diffuse=(0.45, 0.45, 0.45), specular=(0.1, 0.1, 0.1)
    )
    scene.visual.map.znear = 0.02
    getattr(scene.visual, "global").set_attributes(offwidth=MAX_WIDTH, offheight=MAX_HEIGHT)


def _add_room(scene: Element) -> None:
    """Add the floor, the sky, a lamp and the camera."""
    scene.asset.add(
        "texture",
        name="sky",
        type="skybox",
        builtin="gradient",
        width=64,
        height=384,
        rgb1=(0.93, 0.94, 0.96),
        rgb2=(0.74, 0.79, 0.85),
    )
    scene.worldbody.add(
        "geom",
        name="floor",
        type="plane",
        size=(FLOOR_HALF_SIZE, FLOOR_HALF_SIZE, 0.1),
        rgba=(0.92, 0.91, 0.90, 1),
        contype=0,
        conaffinity=humanoid.GLASS,
    )
    scene.worldbody.add(
        "light",
        name="lamp",
        pos=(0, -1.5, 3.5),
        dir=(0, 0.5, -1),
        castshadow=False,
        diffuse=(0.45, 0.45, 0.42),
        specular=(0.1, 0.1, 0.1),
    )
    backwards = [p - t for p, t in zip(CAMERA_POS, CAMERA_TARGET, strict=True)]
    scene.worldbody.add(
        "camera",
        name=CAMERA,
        pos=CAMERA_POS,
        fovy=CAMERA_FOVY,
        xyaxes=(1, 0, 0, 0, backwards[2], -backwards[1]),
    )


def _add_table(scene: Element) -> None:
    """Add a table top on one column."""
    thickness = TABLE_HALF_SIZE[2]
    table = scene.worldbody.add("body", name="table", pos=(0, 0, TABLE_TOP - thickness))
    table.add(
        "geom",
        name="table_top",
        type="box",
        size=TABLE_HALF_SIZE,
        rgba=WOOD,
        group=FURNITURE_GROUP,
        friction=(0.8, 0.005, 0.0001),
        contype=humanoid.FURNITURE,
        conaffinity=humanoid.GLASS,
    )
    length = (TABLE_TOP - 2 * thickness) / 2
    table.add(
        "geom",
        type="cylinder",
        size=(0.05, length),
        pos=(0, 0, -thickness - length),
        rgba=STEEL,
        group=FURNITURE_GROUP,
        **_NO_CONTACT,
    )


def _add_seat(scene: Element, who: str, side: float) -> None:
    """Add the stool on which the waist-up body rests; nothing touches it."""
    top = ROOT_HEIGHT - 0.11
    seat = scene.worldbody.add("body", name=f"{who}_seat", pos=(side * ROOT_DISTANCE / 2, 0, 0))
    seat.add(
        "geom",
        type="cylinder",
        size=(0.17, 0.025),
        pos=(0, 0, top),
        rgba=WOOD,
        group=FURNITURE_GROUP,
        **_NO_CONTACT,
    )
    seat.add(
        "geom",
        type="cylinder",
        size=(0.03, top / 2),
        pos=(0, 0, top / 2),
        rgba=STEEL,
        group=FURNITURE_GROUP,
        **_NO_CONTACT,
    )


def _place(scene: Element, who: str, side: float) -> Element:
    """Return the site where a body is attached: at its seat, facing the table."""
    quat = (1, 0, 0, 0) if side < 0 else (0, 0, 0, 1)
    return scene.worldbody.add(
        "site",
        name=f"{who}_place",
        group=4,
        pos=(side * ROOT_DISTANCE / 2, 0, ROOT_HEIGHT),
        quat=quat,
    )


def _add_head_camera(scene: Element, who: str, side: float) -> None:
    """Add the camera beside a body's head."""
    origin = np.array((side * ROOT_DISTANCE / 2, 0.0, ROOT_HEIGHT))
    add_head_camera(scene, who, origin, np.array((-side, -side, 1.0)))


def _add_glass(scene: Element, who: str, side: float) -> None:
    """Add a free glass of beer; only furniture and the other glass collide with it."""
    half = GLASS_HEIGHT / 2
    pos = (side * (ROOT_DISTANCE / 2 - GLASS_PLACE[0]), -side * GLASS_PLACE[1], TABLE_TOP + half)
    glass = scene.worldbody.add("body", name=f"{who}_glass", pos=pos)
    glass.add("freejoint", name=f"{who}_glass")
    glass.add(
        "geom",
        type="cylinder",
        size=(GLASS_RADIUS, half),
        mass=GLASS_MASS,
        rgba=CLEAR,
        **_NO_CONTACT,
    )
    # Collides as a box: contacts of two boxes need no iterations.
    glass.add(
        "geom",
        name=f"{who}_glass",
        type="box",
        size=(GLASS_SIDE, GLASS_SIDE, half),
        mass=0,
        group=HIDDEN_GROUP,
        condim=4,
        friction=(0.8, 0.005, 0.0001),
        contype=humanoid.GLASS,
        conaffinity=humanoid.FURNITURE | humanoid.GLASS,
    )
    inside = GLASS_RADIUS - 0.004
    glass.add(
        "geom",
        type="cylinder",
        size=(inside, 0.045),
        pos=(0, 0, -0.02),
        rgba=BEER,
        mass=0,
        **_NO_CONTACT,
    )
    glass.add(
        "geom",
        type="cylinder",
        size=(inside, 0.012),
        pos=(0, 0, 0.037),
        rgba=FOAM,
        mass=0,
        **_NO_CONTACT,
    )


def _add_grip(scene: Element, who: str, body: Element) -> None:
    """Add the weld of the closed hand; it is off until the hand takes hold."""
    scene.equality.add(
        "weld",
        name=f"{who}_grip",
        body1=body.find("body", "rradius"),
        body2=scene.find("body", f"{who}_glass"),
        active=False,
        solref=(0.01, 1.0),
    )


def integral_gains() -> np.ndarray:
    """Return the integral gains `[22]` [N m/(rad s)] in the order of the actuators."""
    return np.array(
        [humanoid.KI_PER_KP * humanoid.stiffness(j) for j in humanoid.JOINTS * len(WHO)]
    )


def _add_actuators(scene: Element) -> None:
    """Add one PID per joint, fed with a target [rad], in the order (demonstrator, imitator)."""
    plugin = scene.extension.add("plugin", plugin="mujoco.pid")
    for kp in humanoid.KP.values():
        instance = plugin.add("instance", name=f"kp_{kp:g}")
        gains = {"kp": kp, "ki": humanoid.KI_PER_KP * kp, "imax": humanoid.MAX_INTEGRAL_TORQUE}
        for key, value in gains.items():
            instance.add("config", key=key, value=f"{value:g}")
    for who in WHO:
        for joint in humanoid.JOINTS:
            scene.actuator.add(
                "plugin",
                name=f"{who}_{joint}",
                joint=scene.find("joint", f"{who}/{joint}"),
                plugin="mujoco.pid",
                instance=f"kp_{humanoid.stiffness(joint):g}",
                actdim=1,  # the integral
                ctrllimited=False,  # the model's default would clamp targets to 1 rad
                forcelimited=True,
                forcerange=(-humanoid.MAX_TORQUE, humanoid.MAX_TORQUE),
            )
