"""What an environment's `info` tells of the scene: the true state, and how the task stands."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from envs.grip import Grip
from envs.physics import SceneState
from envs.task import Deeds, measure


def account(
    state: SceneState,
    grips: Sequence[Grip],
    deeds: Sequence[Deeds],
    behaviour: str,
    place: np.ndarray,
) -> dict[str, Any]:
    """Return the true state and the task's measures, after recording what was done.

    Args:
        state: Of the scene.
        grips: Of both bodies.
        deeds: Of both bodies; updated.
        behaviour: "drink", "toast", "move" or "aside".
        place: Final place of both glasses `[2]` [m].

    Returns:
        Those entries of ``info`` that do not depend on the demonstrator's plan.
    """
    measures = [
        measure(state.mouth[row], state.glass[row], state.axis[row], place) for row in (0, 1)
    ]
    success = []
    for done, measured, grip in zip(deeds, measures, grips, strict=True):
        done.update(measured)
        is_put = measured.stands_at_place and not grip.held
        success.append(is_put and done.fulfil(behaviour))
    wrists, angles = state.wrist.copy(), state.angles.copy()
    return {
        "demonstrator_wrist": wrists[0],
        "imitator_wrist": wrists[1],
        "demonstrator_angles": angles[0],
        "imitator_angles": angles[1],
        "imitator_grip": state.grip[1].copy(),
        "imitator_hand": state.hand.copy(),
        "rim_to_mouth": measures[1].rim_to_mouth,
        "glass_from_place": measures[1].glass_from_place,
        "glass_tilt": measures[1].glass_tilt,
        "glass_position": state.glass[1].copy(),
        "glass_held": grips[1].held,
        "mouth_reached": deeds[1].mouth_reached,
        "toasted": deeds[1].toasted,
        "is_success": success[1],
        "demonstrator_success": success[0],
    }
