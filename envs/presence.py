"""Whether there is a demonstrator: it stays, it leaves after a second, or it is never there.

Without one an episode ends 15 s after its reset.
"""

import numpy as np

from envs.behaviours import PHASES
from envs.demonstrator import Demonstration, minimum_jerk

PRESENCES = ("present", "leaves", "absent")

ALONE_STEPS = 750  # of an episode at whose end nobody demonstrates
PERCEIVED_STEPS = 50  # after which one that leaves is no longer perceived
LEAVING_STEPS = 50  # on its way to rest, from then on


def is_perceived(presence: str, step: int) -> bool:
    """Return whether the demonstrator is perceived, `step` control steps after the reset."""
    return presence == "present" or (presence == "leaves" and step < PERCEIVED_STEPS)


def attend(plan: Demonstration, presence: str) -> Demonstration:
    """Return what the demonstrator does of its plan.

    Args:
        plan: Of the whole demonstration.
        presence: One of PRESENCES.

    Returns:
        The plan itself if it is present. If it leaves, the plan fades into rest within a second; a
        glass that a fast one holds by then comes along. If it is absent, its body rests.
    """
    if presence == "present":
        return plan
    steps = np.arange(ALONE_STEPS + 1)
    rest = plan.angles[0]
    phases = np.full(len(steps), PHASES.index("rest"))
    if presence == "absent":
        return Demonstration(np.tile(rest, (len(steps), 1)), phases)
    planned = np.minimum(steps, len(plan.angles) - 1)
    faded = minimum_jerk(np.clip((steps - PERCEIVED_STEPS) / LEAVING_STEPS, 0, 1))[:, None]
    phases[:PERCEIVED_STEPS] = plan.phases[planned[:PERCEIVED_STEPS]]
    phases[PERCEIVED_STEPS : PERCEIVED_STEPS + LEAVING_STEPS] = PHASES.index("withdraw")
    return Demonstration((1 - faded) * plan.angles[planned] + faded * rest, phases)
