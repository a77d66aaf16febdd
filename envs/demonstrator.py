"""The demonstrator's plan: a smooth, timed, seeded trajectory of joint angles for a behaviour.

Each movement runs through its postures on a C2 spline whose parameter follows the minimum-jerk
profile 10 s^3 - 15 s^4 + 6 s^5 (Flash & Hogan 1985), so it starts and ends at rest.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from envs.behaviours import BEHAVIOURS, DRINK, PHASES, Behaviour, Movement
from envs.held_glass import HeldGlass, hold_error
from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from envs.mishaps import beside, interrupt, tremble
from envs.scene import CONTROL_TIMESTEP, GLASS_REST_Z

POSTURE_JITTER = 0.03  # [rad] uniform, of the postures that are not solved by inverse kinematics
PACE_SPREAD = 0.10  # of the whole demonstration, uniform
DURATION_SPREAD = 0.05  # of each phase, uniform


class Demonstration(NamedTuple):
    """A planned episode, one row per control step; row 0 is where the demonstrator starts."""

    angles: np.ndarray  # [T, 11] [rad] targets
    phases: np.ndarray  # [T] index into PHASES


def plan_demonstration(
    body: BodyKinematics,
    glass_place: np.ndarray,
    rng: np.random.Generator,
    *,
    behaviour: str = "drink",
    pace: float = 1.0,
    mishap: str | None = None,
) -> Demonstration:
    """Plan one demonstration.

    Args:
        body: The kinematics of the demonstrator.
        glass_place: Where its glass stands `[2]` [m], body frame.
        rng: Decides pace, durations, the jitter of the postures and a mishap's size.
        behaviour: One of BEHAVIOURS.
        pace: 1.25 is 25 % faster than nominal.
        mishap: One of MISHAPS, or None.

    Returns:
        The plan, at `CONTROL_TIMESTEP`.
    """
    if mishap == "miss":
        glass_place = beside(glass_place, rng)
    schedule = BEHAVIOURS[behaviour].schedule
    postures = solve_postures(body, glass_place, rng, BEHAVIOURS[behaviour])
    if mishap == "interrupted":
        postures, schedule = interrupt(postures, schedule, rng)
    pace = pace * rng.uniform(1 - PACE_SPREAD, 1 + PACE_SPREAD)
    stretch = rng.uniform(1 - DURATION_SPREAD, 1 + DURATION_SPREAD, size=len(schedule)) / pace
    plan = _connect(postures, schedule, stretch)
    if mishap == "tremor":
        plan = plan._replace(angles=tremble(plan.angles, body.joint_range, rng))
    return plan


def _connect(
    postures: dict[str, np.ndarray], schedule: tuple[Movement, ...], stretch: np.ndarray
) -> Demonstration:
    """Connect the movements, each as long as its nominal duration times its stretch."""
    angles, phases = [postures["rest"][None]], [0]
    for (phase, via, duration), factor in zip(schedule, stretch, strict=True):
        n_steps = max(1, round(duration * factor / CONTROL_TIMESTEP))
        angles.append(_move(np.stack([postures[name] for name in via]), n_steps))
        phases += [PHASES.index(phase)] * n_steps
    return Demonstration(np.concatenate(angles), np.array(phases))


def _move(via: np.ndarray, n_steps: int) -> np.ndarray:
    """Return angles `[n_steps, 11]` [rad] through `via` `[V, 11]`, from rest to rest."""
    if len(via) == 1:
        return np.repeat(via, n_steps, axis=0)
    progress = minimum_jerk(np.arange(1, n_steps + 1) / n_steps)
    chords = np.linalg.norm(np.diff(via, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(chords) / chords.sum()])
    return CubicSpline(knots, via, bc_type="natural")(progress)


def minimum_jerk(time: np.ndarray) -> np.ndarray:
    """Return the progress `[T]` of a movement from rest to rest, at shares of its time `[T]`."""
    return time**3 * (10 - 15 * time + 6 * time**2)


def solve_postures(
    body: BodyKinematics,
    glass_place: np.ndarray,
    rng: np.random.Generator,
    behaviour: Behaviour = DRINK,
) -> dict[str, np.ndarray]:
    """Jitter the free postures and solve those with the glass in hand.

    Args:
        body: The kinematics of the demonstrator.
        glass_place: Where its glass stands `[2]` [m], body frame.
        rng: Decides the jitter.
        behaviour: Whose postures.

    Returns:
        Name -> posture `[11]` [rad].
    """
    names = tuple(behaviour.postures)
    jitter = rng.uniform(-POSTURE_JITTER, POSTURE_JITTER, size=(len(names), len(JOINTS)))
    low, high = body.joint_range.T
    starts = {
        name: np.clip(np.deg2rad(behaviour.postures[name]) + offset, low, high)
        for name, offset in zip(names, jitter, strict=True)
    }
    standing = np.array([*glass_place, GLASS_REST_Z])
    starts["grasp"] = body.solve(starts["grasp"], lambda pose: hold_error(pose, standing))
    held = HeldGlass.from_grasp(body.pose(starts["grasp"]), standing)
    carried = {
        name: body.solve(starts[start], lambda pose, error=error: error(held, pose, standing))
        for name, (start, error) in behaviour.carried.items()
    }
    return starts | carried
