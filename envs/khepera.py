"""A Khepera-like robot in MuJoCo's XML: a disc with two wheels and six infra-red sensors in front.

It moves on planar joints. Velocity servos act at the two points where wheels touch the floor, and
one prevents sideways sliding. The controls are two wheel speeds, without rolling contacts.
"""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

RADIUS = 0.0275  # [m]
HEIGHT = 0.03  # [m]
MASS = 0.08  # [kg]
WHEEL_BASE = 0.053  # [m] between the wheels
MAX_WHEEL_SPEED = 0.12  # [m/s]
SERVO_GAIN = 20.0  # [N s/m] reaches a speed within 2 ms, with less than 1 % sideways slip

INFRARED_NAMES = ("left_90", "left_45", "left_12", "right_12", "right_45", "right_90")
INFRARED_ANGLES = np.deg2rad([90.0, 45.0, 12.0, -12.0, -45.0, -90.0])  # positive to the left
RAY_ANGLES = np.deg2rad([-15.0, 0.0, 15.0])  # of the rays of one sensor, averaged
REACH = 0.07  # [m] beyond which a sensor reads nothing
HALF_RESPONSE, LENGTH = 0.03, 0.010  # [m] of the sigmoid response to distance

BODY_COLOURS = {"learner": "0.85 0.37 0.0 1", "teacher": "0.0 0.45 0.70 1"}


def add_robot(world: Element, actuators: Element, sensors: Element, name: str) -> None:
    """Add a robot to a model's worldbody, actuator and sensor sections.

    Args:
        world: `<worldbody>`.
        actuators: `<actuator>`; gets left wheel, right wheel, and the hidden lateral servo.
        sensors: `<sensor>`; gets the rays, sensor by sensor.
        name: "learner" or "teacher"; prefixes every element.
    """
    body = SubElement(world, "body", name=name, pos=f"0 0 {HEIGHT / 2 + 0.002}")
    for axis, kind in (("x", "slide"), ("y", "slide"), ("turn", "hinge")):
        direction = {"x": "1 0 0", "y": "0 1 0", "turn": "0 0 1"}[axis]
        SubElement(body, "joint", name=f"{name}/{axis}", type=kind, axis=direction)
    _add_shape(body, name)
    for side, y in (("left", WHEEL_BASE / 2), ("right", -WHEEL_BASE / 2)):
        _add_servo(body, actuators, f"{name}/{side}_wheel", f"0 {y} 0", "1 0 0 0 0 0")
    _add_servo(body, actuators, f"{name}/lateral", "0 0 0", "0 1 0 0 0 0")
    for sensor, angle in zip(INFRARED_NAMES, INFRARED_ANGLES, strict=True):
        for ray, turn in enumerate(RAY_ANGLES):
            _add_ray(body, sensors, f"{name}/{sensor}_{ray}", angle, turn)


def infrared(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the noiseless readings of the sensors.

    Args:
        distances: Of each ray from the rim to what it hits `[6, 3]` [m]; negative for nothing.

    Returns:
        Readings `[6]` from 0, nothing within reach, to 1, contact.
    """
    seen = (distances >= 0) & (distances <= REACH)
    response = 1 / (1 + np.exp((distances - HALF_RESPONSE) / LENGTH))
    at_contact = 1 / (1 + math.exp(-HALF_RESPONSE / LENGTH))
    return np.where(seen, response / at_contact, 0.0).sum(axis=1) / len(RAY_ANGLES)


def wheel_speeds(speed: float, turn: float) -> NDArray[np.float64]:
    """Return the speeds of the left and the right wheel `[2]` [m/s].

    Args:
        speed: Forwards [m/s].
        turn: To the left [rad/s].
    """
    return np.array([speed - turn * WHEEL_BASE / 2, speed + turn * WHEEL_BASE / 2])


def _add_shape(body: Element, name: str) -> None:
    SubElement(
        body, "geom", name=f"{name}/hull", type="cylinder", size=f"{RADIUS} {HEIGHT / 2}",
        mass=str(MASS), rgba=BODY_COLOURS[name], friction="0.05",
    )  # fmt: skip
    painted = {"type": "box", "contype": "0", "conaffinity": "0", "mass": "0"}
    nose = {"size": f"{RADIUS / 2} 0.004 0.001", "rgba": "1 1 1 1"}
    SubElement(body, "geom", {**painted, **nose}, pos=f"{RADIUS / 2} 0 {HEIGHT / 2}")
    wheel = {"size": "0.012 0.002 0.001", "rgba": "0.1 0.1 0.1 1"}
    for y in (WHEEL_BASE / 2 - 0.004, -WHEEL_BASE / 2 + 0.004):
        SubElement(body, "geom", {**painted, **wheel}, pos=f"0 {y} {HEIGHT / 2}")


def _add_servo(body: Element, actuators: Element, name: str, place: str, gear: str) -> None:
    SubElement(body, "site", name=name, pos=place, size="0.001", rgba="0 0 0 0")
    SubElement(actuators, "velocity", name=name, site=name, gear=gear, kv=str(SERVO_GAIN))


def _add_ray(body: Element, sensors: Element, name: str, angle: float, turn: float) -> None:
    place = f"{RADIUS * math.cos(angle)} {RADIUS * math.sin(angle)} 0"
    direction = f"{math.cos(angle + turn)} {math.sin(angle + turn)} 0"
    SubElement(
        body, "site", name=name, pos=place, zaxis=direction, size="0.0005", rgba="0 0 0 0"
    )  # fmt: skip
    SubElement(sensors, "rangefinder", name=name, site=name)
