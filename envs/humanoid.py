"""A waist-up humanoid with 11 joints, made from dm_control's CMU humanoid (V2020, scaled by 1.2).

The body frame is the root's: x forwards, y to the left, z up, its origin at the pelvis. Everything
below the waist is removed; spine, collar bones, wrists and fingers are welded; three hinges of the
head, three of each shoulder and one of each elbow are kept.
"""

from pathlib import Path
from typing import Any

import numpy as np
from dm_control import mjcf
from dm_control.locomotion import walkers
from dm_control.locomotion.walkers import rescale
from mujoco import mju_mulQuat, mju_normalize4, mju_rotVecQuat  # pyright: ignore[reportAttributeAccessIssue]

Element = Any  # of PyMJCF, whose attributes are made at run time

XML_PATH = Path(walkers.__file__).parent / "assets" / "humanoid_CMU_V2020.xml"
SCALE = 1.2

# Readable name -> joint of the CMU model, in the order of every 11-vector of this package.
JOINT_SOURCES = {
    "neck_rz": "headrz",
    "neck_ry": "headry",
    "neck_rx": "headrx",
    "right_shoulder_rz": "rhumerusrz",
    "right_shoulder_ry": "rhumerusry",
    "right_shoulder_rx": "rhumerusrx",
    "right_elbow": "rradiusrx",
    "left_shoulder_rz": "lhumerusrz",
    "left_shoulder_ry": "lhumerusry",
    "left_shoulder_rx": "lhumerusrx",
    "left_elbow": "lradiusrx",
}
JOINTS = tuple(JOINT_SOURCES)

# Welded joints that are not at zero, applied in this order: body -> ((axis, degrees), ...).
# The right wrist holds an upright glass with the thumb up; fingers and thumbs are half closed.
FIXED_ANGLES = {
    "rwrist": (("y", -92.0),),
    "rhand": (("z", 11.0), ("x", -55.0)),
    "rfingers": (("x", 62.0),),
    "rthumb": (("z", 0.0), ("x", 70.0)),
    "lwrist": (("y", 10.0),),
    "lhand": (("z", 0.0), ("x", -38.0)),
    "lfingers": (("x", 12.0),),
    "lthumb": (("z", 0.0), ("x", 25.0)),
}

# Sites in the frame of the body that carries them [m, after scaling].
GRIP_POS = (0.0, -0.072, -0.060)  # right hand: axis of a glass in the palm
MOUTH_POS = (0.0, 0.012, 0.137)  # head: just before the lips

# Bodies that the shirt covers.
DRESSED = (
    "root",
    "lowerback",
    "upperback",
    "thorax",
    "lclavicle",
    "rclavicle",
    "lhumerus",
    "rhumerus",
)

# Collision bits. Arms do not collide with glasses, because a hand must be able to reach inside.
FURNITURE, BODY, FOREARM, GLASS = 1, 2, 4, 8

# Joint PID: torque = kp e + ki (integral of e), and damping that the integrator treats implicitly.
# benchmarks/postural_control.py compares it with others; a derivative term would add to the lag.
KP = {"neck": 480.0, "shoulder": 960.0, "elbow": 720.0}  # [N m/rad]
KI_PER_KP = 0.5  # [1/s]
DAMPING_PER_KP = 1 / 60  # [s]
MAX_INTEGRAL_TORQUE = 60.0  # [N m]
MAX_TORQUE = 150.0  # [N m]
ARMATURE = 0.02  # [kg m^2]


def stiffness(joint: str) -> float:
    """Return the proportional gain [N m/rad] of a joint of `JOINTS`."""
    return next(kp for part, kp in KP.items() if part in joint)


def build_humanoid(name: str, shirt: tuple[float, ...], skin: tuple[float, ...]) -> Element:
    """Build one body, to be attached to a scene.

    Args:
        name: Prefix of every element once attached.
        shirt: RGBA of trunk and upper arms.
        skin: RGBA of head, forearms and hands.

    Returns:
        A PyMJCF model with 11 hinges, no actuators, and the sites ``wrist``, ``grip``, ``mouth``.
    """
    model: Element = mjcf.from_path(str(XML_PATH))
    model.model = name
    _strip(model)
    rescale.rescale_subtree(model.find("body", "root"), SCALE, SCALE)
    _weld(model)
    _name_joints(model)
    _paint(model, shirt, skin)
    _collide(model)
    _add_sites(model)
    return model


def _strip(model: Element) -> None:
    """Remove the legs, and elements that refer to them: sensors, actuators, cameras, lights."""
    for kind in ("actuator", "sensor", "contact", "camera", "light", "site"):
        for element in model.find_all(kind):
            element.remove()
    for body in ("lhipjoint", "rhipjoint"):
        model.find("body", body).remove()
    root = model.find("body", "root")
    root.quat = (0.5, 0.5, 0.5, 0.5)  # the CMU model's y is up and its z is forwards


def _weld(model: Element) -> None:
    """Turn the fixed joints to their angles and delete every joint that is not kept."""
    for body_name, rotations in FIXED_ANGLES.items():
        body = model.find("body", body_name)
        for axis, degrees in rotations:
            _turn(body, axis, np.deg2rad(degrees))
    for joint in model.find_all("joint"):
        if joint.name not in JOINT_SOURCES.values():
            joint.remove()


def _turn(body: Element, axis: str, angle: float) -> None:
    """Rotate `body` by `angle` [rad] about its joint of that axis, as the joint would."""
    quat = np.array((1.0, 0.0, 0.0, 0.0)) if body.quat is None else np.asarray(body.quat)
    turn = np.zeros(4)
    turn[0], turn["xyz".index(axis) + 1] = np.cos(angle / 2), np.sin(angle / 2)
    joint = next(j for j in body.find_all("joint") if j.name == f"{body.name}r{axis}")
    pivot = np.zeros(3) if joint.pos is None else np.asarray(joint.pos)
    before, after = np.empty(3), np.empty(3)
    turned = np.empty(4)
    mju_normalize4(quat)
    mju_mulQuat(turned, quat, turn)
    mju_rotVecQuat(before, pivot, quat)
    mju_rotVecQuat(after, pivot, turned)
    body.pos = np.asarray(body.pos) + before - after
    body.quat = turned


def _name_joints(model: Element) -> None:
    """Give the kept joints their readable names and the constants that every joint shares."""
    for name, source in JOINT_SOURCES.items():
        joint = model.find("joint", source)
        joint.name = name
        damping = DAMPING_PER_KP * stiffness(name)
        joint.set_attributes(stiffness=0.0, damping=damping, armature=ARMATURE)


def _paint(model: Element, shirt: tuple[float, ...], skin: tuple[float, ...]) -> None:
    """Colour the geoms and give the head a face that shows where it looks."""
    for geom in model.find_all("geom"):
        geom.rgba = shirt if geom.parent.name in DRESSED else skin
        geom.material = None
    head = model.find("body", "head")
    face = {"contype": 0, "conaffinity": 0, "mass": 0.0}
    for side in (-1, 1):
        head.add(
            "geom",
            type="sphere",
            size=(0.014,),
            pos=(side * 0.04, 0.085, 0.131),
            rgba=(0.08, 0.08, 0.1, 1),
            **face,
        )
    head.add("geom", type="sphere", size=(0.016,), pos=(0, 0.053, 0.145), rgba=skin, **face)
    head.add(
        "geom",
        type="capsule",
        fromto=(-0.024, 0.012, 0.13, 0.024, 0.012, 0.13),
        size=(0.006,),
        rgba=(0.55, 0.2, 0.2, 1),
        **face,
    )


def _collide(model: Element) -> None:
    """Let forearms collide with furniture, bodies and one another, and bodies with forearms.

    Neighbours overlap by design. Hands, and geoms that are only drawn, collide with nothing.
    """
    for geom in model.find_all("geom"):
        body = geom.parent.name
        if geom.contype == 0:
            continue
        if "finger" in body or "thumb" in body or "hand" in body:
            geom.set_attributes(contype=0, conaffinity=0)
        elif body[1:] in ("radius", "wrist"):
            geom.set_attributes(contype=FOREARM, conaffinity=FURNITURE | BODY | FOREARM)
        else:
            geom.set_attributes(contype=BODY, conaffinity=FOREARM)


def _add_sites(model: Element) -> None:
    """Add the sites that the scene uses: wrist, grip and mouth."""
    for name, body, pos in (
        ("wrist", "rwrist", (0.0, 0.0, 0.0)),
        ("grip", "rhand", GRIP_POS),
        ("mouth", "head", MOUTH_POS),
    ):
        model.find("body", body).add("site", name=name, pos=pos, size=(0.008,), group=4)
