"""The demonstrator's plan: a smooth, timed, seeded trajectory of joint angles that drinks a beer.

Each movement runs through its postures on a C2 spline whose parameter follows the minimum-jerk
profile 10 s^3 - 15 s^4 + 6 s^5 (Flash & Hogan 1985), so that it starts and ends at rest.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics, BodyPose
from envs.scene import CONTROL_TIMESTEP, GLASS_HEIGHT, GLASS_RADIUS, GLASS_REST_Z, GRIP_HEIGHT

PHASES = ("rest", "approach", "grasp", "lift", "drink", "put", "release", "withdraw")

# Postures in degrees: neck (rz, ry, rx), right arm and left arm (shoulder rz, ry, rx, elbow).
LEFT_ARM = (58.0, -46.0, -11.0, 78.0)
POSTURES = {
    "rest": (0.0, 0.0, 0.0, -43.0, 59.0, -40.0, 116.0, *LEFT_ARM),
    "pre": (-6.0, 0.0, 12.0, -14.0, 69.0, 30.0, 99.0, *LEFT_ARM),
    "grasp": (-6.0, 0.0, 18.0, -19.0, 64.0, 44.0, 79.0, *LEFT_ARM),
    "lift": (-3.0, 0.0, 10.0, -15.0, 60.0, 45.0, 85.0, *LEFT_ARM),
    "mouth": (0.0, 0.0, 0.0, -2.0, 9.0, 56.0, 137.0, *LEFT_ARM),
    "drink": (0.0, 0.0, -10.0, 3.0, -4.0, 51.0, 136.0, *LEFT_ARM),
}
REST_POSTURE = np.deg2rad(POSTURES["rest"])

CLEARANCE = 0.06  # [m] the glass is lifted straight up, and comes straight down, this much
PRESS = 0.003  # [m] the glass is put down as if the table were this much lower
MOUTH_TILT, DRINK_TILT = np.deg2rad(25.0), np.deg2rad(50.0)  # of the glass, towards the face
AXIS_WEIGHT = 0.05  # [m/rad] how much a wrong tilt counts beside a wrong place

UP = np.array((0.0, 0.0, 1.0))

POSTURE_JITTER = 0.03  # [rad] uniform, of the postures that no inverse kinematics decides
PACE_SPREAD = 0.10  # of the whole demonstration, uniform
DURATION_SPREAD = 0.05  # of each phase, uniform

# Phase -> (postures passed through, nominal duration [s]). A single posture is a pause.
SCHEDULE = (
    ("rest", ("rest",), 0.3),
    ("approach", ("rest", "pre", "grasp"), 1.8),
    ("grasp", ("grasp",), 0.4),
    ("lift", ("grasp", "above", "mouth"), 2.0),
    ("drink", ("mouth", "drink", "mouth"), 1.2),
    ("put", ("mouth", "above", "put"), 2.1),
    ("release", ("put",), 0.4),
    ("withdraw", ("put", "pre", "rest"), 1.7),
    ("rest", ("rest",), 0.3),
)


class Demonstration(NamedTuple):
    """A planned episode, one row per control step; row 0 is where the demonstrator starts."""

    angles: np.ndarray  # (T, 11) [rad] targets
    phases: np.ndarray  # (T,) index into PHASES


def plan_drink(
    body: BodyKinematics, glass_place: np.ndarray, rng: np.random.Generator, pace: float = 1.0
) -> Demonstration:
    """Plans one demonstration.

    Args:
        body: the kinematics of the demonstrator.
        glass_place: where its glass stands (2,) [m], body frame.
        rng: decides pace, durations and the jitter of the postures.
        pace: 1.25 is 25 % faster than taught.

    Returns:
        The plan, at `CONTROL_TIMESTEP`.
    """
    postures = solve_postures(body, glass_place, rng)
    pace = pace * rng.uniform(1 - PACE_SPREAD, 1 + PACE_SPREAD)
    stretch = rng.uniform(1 - DURATION_SPREAD, 1 + DURATION_SPREAD, size=len(SCHEDULE)) / pace
    angles, phases = [postures["rest"][None]], [0]
    for (phase, names, duration), factor in zip(SCHEDULE, stretch, strict=True):
        n_steps = max(1, round(duration * factor / CONTROL_TIMESTEP))
        angles.append(_move(np.stack([postures[name] for name in names]), n_steps))
        phases += [PHASES.index(phase)] * n_steps
    return Demonstration(np.concatenate(angles), np.array(phases))


def _move(via: np.ndarray, n_steps: int) -> np.ndarray:
    """Angles (n_steps, 11) [rad] of a movement through `via` (V, 11), from rest to rest."""
    if len(via) == 1:
        return np.repeat(via, n_steps, axis=0)
    time = np.arange(1, n_steps + 1) / n_steps
    progress = time**3 * (10 - 15 * time + 6 * time**2)
    chords = np.linalg.norm(np.diff(via, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(chords) / chords.sum()])
    return CubicSpline(knots, via, bc_type="natural")(progress)


def solve_postures(
    body: BodyKinematics, glass_place: np.ndarray, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Jitters the free postures and solves those that must meet the glass or the mouth.

    Args:
        body: the kinematics of the demonstrator.
        glass_place: where its glass stands (2,) [m], body frame.
        rng: decides the jitter.

    Returns:
        Name -> posture (11,) [rad].
    """
    names = tuple(POSTURES)
    jitter = rng.uniform(-POSTURE_JITTER, POSTURE_JITTER, size=(len(names), len(JOINTS)))
    low, high = body.joint_range.T
    postures = {
        name: np.clip(np.deg2rad(POSTURES[name]) + offset, low, high)
        for name, offset in zip(names, jitter, strict=True)
    }
    standing = np.array([*glass_place, GLASS_REST_Z])
    grasp = body.solve(postures["grasp"], lambda pose: _hold_error(pose, standing))
    held = HeldGlass.from_grasp(body.pose(grasp), standing)

    def carry(start: str, height: float) -> np.ndarray:
        centre = standing + height * UP
        return body.solve(postures[start], lambda pose: held.stand_error(pose, centre))

    def drink(start: str, tilt: float) -> np.ndarray:
        return body.solve(postures[start], lambda pose: held.drink_error(pose, tilt))

    postures["grasp"] = grasp
    postures["above"] = carry("lift", CLEARANCE)
    postures["mouth"], postures["drink"] = drink("mouth", MOUTH_TILT), drink("drink", DRINK_TILT)
    postures["put"] = carry("grasp", -PRESS)
    return postures


def _hold_error(pose: BodyPose, glass: np.ndarray) -> np.ndarray:
    """Residuals [m] of a hand about to hold the glass that stands at `glass` (3,), thumb up."""
    point = glass + GRIP_HEIGHT * UP
    thumb = pose.hand[:, 0]
    return np.concatenate([pose.grip - point, 0.2 * AXIS_WEIGHT * (thumb - UP)])


class HeldGlass(NamedTuple):
    """A glass fixed in the hand: its middle and its axis in the hand's frame, from the grip."""

    centre: np.ndarray  # (3,) [m]
    axis: np.ndarray  # (3,)

    @classmethod
    def from_grasp(cls, pose: BodyPose, glass: np.ndarray) -> "HeldGlass":
        """The glass that stands at `glass` (3,) [m], held by a hand at `pose`."""
        return cls(pose.hand.T @ (glass - pose.grip), pose.hand[2])

    def stand_error(self, pose: BodyPose, centre: np.ndarray) -> np.ndarray:
        """Residuals [m] against a glass upright with its middle at `centre` (3,) [m]."""
        axis = pose.hand @ self.axis
        place = pose.grip + pose.hand @ self.centre
        return np.concatenate([place - centre, AXIS_WEIGHT * axis[:2]])

    def drink_error(self, pose: BodyPose, tilt: float) -> np.ndarray:
        """Residuals [m] against a rim at the mouth and a glass tilted by `tilt` [rad]."""
        axis = pose.hand @ self.axis
        rim = pose.grip + pose.hand @ self.centre + GLASS_HEIGHT / 2 * axis
        wanted = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
        return np.concatenate(
            [
                nearest_on_rim(rim, axis, pose.mouth) - pose.mouth,
                0.4 * AXIS_WEIGHT * (axis - wanted),
            ]
        )


def nearest_on_rim(rim: np.ndarray, axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    """The point of the rim's circle nearest to a point.

    Args:
        rim: the circle's centre (3,) [m].
        axis: the glass's axis (3,), of length one.
        point: (3,) [m].

    Returns:
        The nearest point (3,) [m].
    """
    offset = point - rim
    radial = offset - (offset @ axis) * axis
    return rim + GLASS_RADIUS * radial / max(float(np.linalg.norm(radial)), 1e-9)
