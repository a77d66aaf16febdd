"""What can go wrong in a demonstration: a tremor, an interruption, or a hand that misses the glass.

The sizes are drawn from the episode's generator.
"""

import numpy as np

from envs.behaviours import Movement
from envs.kinematics import RIGHT_ARM
from envs.scene import CONTROL_TIMESTEP

MISHAPS = ("tremor", "interrupted", "miss")

TREMOR_AMPLITUDE = (0.10, 0.15)  # [rad] of each joint of the right arm
TREMOR_FREQUENCY = (4.0, 6.0)  # [Hz]
INTERRUPTION = (0.3, 0.6)  # share of the way at which the hand turns back
MISS_DISTANCE = (0.06, 0.08)  # [m] beside the glass


def tremble(angles: np.ndarray, joint_range: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Add a tremor of one frequency to the right arm.

    Args:
        angles: As planned `[T, 11]` [rad], at `CONTROL_TIMESTEP`.
        joint_range: `[11, 2]` [rad].
        rng: Decides frequency, and each joint's amplitude and phase.

    Returns:
        The trembling angles `[T, 11]` [rad], within the joint ranges.
    """
    amplitude = rng.uniform(*TREMOR_AMPLITUDE, size=len(RIGHT_ARM))
    phase = rng.uniform(0, 2 * np.pi, size=len(RIGHT_ARM))
    time = CONTROL_TIMESTEP * np.arange(len(angles))
    turns = 2 * np.pi * rng.uniform(*TREMOR_FREQUENCY) * time
    trembling = angles.copy()
    trembling[:, RIGHT_ARM] += amplitude * np.sin(turns[:, None] + phase)
    return np.clip(trembling, *joint_range.T)


def interrupt(
    postures: dict[str, np.ndarray], schedule: tuple[Movement, ...], rng: np.random.Generator
) -> tuple[dict[str, np.ndarray], tuple[Movement, ...]]:
    """Interrupt the first movement with the glass: it is put back, and the behaviour ends.

    Args:
        postures: Name -> posture `[11]` [rad].
        schedule: Of the whole behaviour.
        rng: Decides how far the glass gets.

    Returns:
        Postures and schedule with the interruption.
    """
    phases = [movement.phase for movement in schedule]
    taken, released = phases.index("grasp") + 1, phases.index("release")
    phase, (start, above, goal), duration = schedule[taken]
    way = postures[goal] - postures[above]
    turning = postures[above] + rng.uniform(*INTERRUPTION) * way
    # The glass is put down at its old place, whatever the goal was.
    put_down = schedule[released].via[0]
    interrupted = (
        Movement(phase, (start, above, "turning"), duration),
        Movement("put", ("turning", above, put_down), duration),
    )
    return (
        {**postures, "turning": turning, put_down: postures["put"]},
        (*schedule[:taken], *interrupted, *schedule[released:]),
    )


def beside(glass_place: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a place beside the glass, before it or to its right, where the hand comes from.

    Args:
        glass_place: `[2]` [m], body frame.
        rng: Decides distance and direction.

    Returns:
        The place `[2]` [m], where a hand finds nothing.
    """
    distance = rng.uniform(*MISS_DISTANCE)
    direction = rng.uniform(np.pi, 1.5 * np.pi)  # [rad] from forwards, to the left
    return glass_place + distance * np.array((np.cos(direction), np.sin(direction)))
