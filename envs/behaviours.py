"""The demonstrator's behaviours: drink, toast, move and aside, each as postures and a schedule.

In a toast the glass and the other hand are raised before the drink, and the hand stays on the table
at the end; drink and toast are identical up to the grasp. In a move the glass is carried over the
table, with the head turned to its goal and the left hand off the table. Aside is a drink, but the
glass is put down beside the place it was taken from.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from envs.held_glass import UP, HeldGlass
from envs.kinematics import BodyPose
from envs.task import ASIDE, MOVE, TOAST_POINT

PHASES = (
    "rest",
    "approach",
    "grasp",
    "lift",
    "drink",
    "put",
    "release",
    "withdraw",
    "toast",
    "carry",
)

CLEARANCE = 0.06  # [m] height of the vertical first and last part of a glass's way
MOVE_CLEARANCE = 0.04  # [m] the same for a move; the arc between is higher
PRESS = 0.003  # [m] below the table at which the glass is put down
MOUTH_TILT, DRINK_TILT = np.deg2rad(25.0), np.deg2rad(50.0)  # of the glass, towards the face

# Residuals [m] of a body with a glass in hand that stood at [3] [m] when it was taken.
GlassError = Callable[[HeldGlass, BodyPose, np.ndarray], np.ndarray]


class Movement(NamedTuple):
    """One phase of a behaviour."""

    phase: str  # of PHASES
    via: tuple[str, ...]  # postures passed through; a single one is a pause
    duration: float  # [s] nominal


class Behaviour(NamedTuple):
    """All that defines a demonstration except its seed."""

    # Free postures in degrees: neck (rz, ry, rx), right and left arm (shoulder rz, ry, rx, elbow).
    postures: dict[str, tuple[float, ...]]
    # Postures with the glass in hand: start posture and error of the inverse kinematics.
    carried: dict[str, tuple[str, GlassError]]
    schedule: tuple[Movement, ...]  # the movement after "grasp" goes via "grasp", "above", ...


def _upright_by(offset: np.ndarray) -> GlassError:
    """Return the error of an upright glass, away by `offset` `[3]` [m] from where it stood."""
    return lambda held, pose, standing: held.stand_error(pose, standing + offset)


def _upright_at(point: np.ndarray) -> GlassError:
    """Return the error of an upright glass with its middle at `point` `[3]` [m]."""
    return lambda held, pose, _: held.stand_error(pose, point)


def _at_mouth(tilt: float) -> GlassError:
    """Return the error of a rim at the mouth, with the glass tilted by `tilt` [rad]."""
    return lambda held, pose, _: held.drink_error(pose, tilt)


LEFT_ARM, LEFT_ARM_AWAY = (58.0, -46.0, -11.0, 78.0), (43.0, -59.0, -40.0, 116.0)
LEFT_ARM_RAISED = (40.0, -20.0, -30.0, 130.0)
REST = (0.0, 0.0, 0.0, -43.0, 59.0, -40.0, 116.0, *LEFT_ARM)
REST_POSTURE = np.deg2rad(REST)

_DOWN = _upright_by(-PRESS * UP)
_MOVED, _ASIDE = np.array((*MOVE, 0.0)), np.array((*ASIDE, 0.0))

_BEGINNING = (
    Movement("rest", ("rest",), 0.3),
    Movement("approach", ("rest", "pre", "grasp"), 1.8),
    Movement("grasp", ("grasp",), 0.4),
)
_SIP = Movement("drink", ("mouth", "drink", "mouth"), 1.2)
_DRINK_AND_PUT = (
    _SIP,
    Movement("put", ("mouth", "above", "put"), 2.1),
    Movement("release", ("put",), 0.4),
)

DRINK = Behaviour(
    postures={
        "rest": REST,
        "pre": (-6.0, 0.0, 12.0, -14.0, 69.0, 30.0, 99.0, *LEFT_ARM),
        "grasp": (-6.0, 0.0, 18.0, -19.0, 64.0, 44.0, 79.0, *LEFT_ARM),
        "lift": (-3.0, 0.0, 10.0, -15.0, 60.0, 45.0, 85.0, *LEFT_ARM),
        "mouth": (0.0, 0.0, 0.0, -2.0, 9.0, 56.0, 137.0, *LEFT_ARM),
        "drink": (0.0, 0.0, -10.0, 3.0, -4.0, 51.0, 136.0, *LEFT_ARM),
    },
    carried={
        "above": ("lift", _upright_by(CLEARANCE * UP)),
        "mouth": ("mouth", _at_mouth(MOUTH_TILT)),
        "drink": ("drink", _at_mouth(DRINK_TILT)),
        "put": ("grasp", _DOWN),
    },
    schedule=(
        *_BEGINNING,
        Movement("lift", ("grasp", "above", "mouth"), 2.0),
        *_DRINK_AND_PUT,
        Movement("withdraw", ("put", "pre", "rest"), 1.7),
        Movement("rest", ("rest",), 0.3),
    ),
)
TOAST = Behaviour(
    postures={
        **DRINK.postures,
        **{
            name: (*DRINK.postures[name][:-4], *LEFT_ARM_RAISED)
            for name in ("lift", "mouth", "drink")
        },
        "toast": (0.0, 0.0, 0.0, -16.0, 39.0, 34.0, 92.0, *LEFT_ARM_RAISED),
        "down": (*DRINK.postures["grasp"][:-4], *LEFT_ARM_RAISED),
        "beside": (0.0, 0.0, 6.0, -12.0, 66.0, 28.0, 82.0, *LEFT_ARM),
    },
    carried={
        **DRINK.carried,
        "toast": ("toast", _upright_at(np.array(TOAST_POINT))),
        "put": ("down", _DOWN),
    },
    schedule=(
        *_BEGINNING,
        Movement("toast", ("grasp", "above", "toast"), 1.7),
        Movement("toast", ("toast",), 0.4),
        Movement("lift", ("toast", "mouth"), 1.6),
        *_DRINK_AND_PUT,
        Movement("withdraw", ("put", "pre", "beside"), 1.4),
        Movement("rest", ("beside",), 0.3),
    ),
)
MOVE_OVER = Behaviour(
    postures={
        "rest": REST,
        "pre": (-25.0, 0.0, 12.0, -9.0, 58.0, 22.0, 109.0, *LEFT_ARM_AWAY),
        "grasp": (-25.0, 0.0, 18.0, -19.0, 64.0, 44.0, 79.0, *LEFT_ARM_AWAY),
        "lift": (-25.0, 0.0, 14.0, -15.0, 60.0, 45.0, 85.0, *LEFT_ARM_AWAY),
        "there": (-25.0, 0.0, 18.0, -31.0, 62.0, 3.0, 94.0, *LEFT_ARM_AWAY),
    },
    carried={
        "above": ("lift", _upright_by(MOVE_CLEARANCE * UP)),
        "over": ("there", _upright_by(_MOVED + MOVE_CLEARANCE * UP)),
        "there": ("there", _upright_by(_MOVED - PRESS * UP)),
        "put": ("grasp", _DOWN),
    },
    schedule=(
        *_BEGINNING,
        Movement("carry", ("grasp", "above", "over"), 1.8),
        Movement("put", ("over", "there"), 1.0),
        Movement("release", ("there",), 0.4),
        Movement("withdraw", ("there", "rest"), 1.5),
        Movement("rest", ("rest",), 0.3),
    ),
)
PUT_ASIDE = Behaviour(
    postures=DRINK.postures,
    carried={
        **DRINK.carried,
        "over": ("lift", _upright_by(_ASIDE + CLEARANCE * UP)),
        "there": ("grasp", _upright_by(_ASIDE - PRESS * UP)),
    },
    schedule=(
        *_BEGINNING,
        Movement("lift", ("grasp", "above", "mouth"), 2.0),
        _SIP,
        Movement("put", ("mouth", "over", "there"), 2.1),
        Movement("release", ("there",), 0.4),
        Movement("withdraw", ("there", "pre", "rest"), 1.7),
        Movement("rest", ("rest",), 0.3),
    ),
)
BEHAVIOURS = {"drink": DRINK, "toast": TOAST, "move": MOVE_OVER, "aside": PUT_ASIDE}
