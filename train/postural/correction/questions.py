"""What an imitator asks when it cannot go on: what is in its way, by how much, and what helps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envs.postural_imitation import GLASS_NAMES
from pacnet.imitator.records import ImitatorStep

_PLACE, _TURN = GLASS_NAMES[:3], GLASS_NAMES[3:]  # [m], [rad]


def question(step: ImitatorStep, percept: NDArray[np.float32]) -> str:
    """Return in one sentence what is novel, with numbers, and what would help.

    Args:
        step: At which the imitator paused.
        percept: At that step `[28]`; it ends with the glass, all zeros if none is perceived.

    Raises:
        ValueError: Nothing was novel at that step.
    """
    if not step.is_novel:
        raise ValueError(f"expected a step that is novel, got one of novelty {step.novelty:.2f}")
    name, off, most = step.dimension, step.deviation, step.threshold
    is_seen = percept[-len(GLASS_NAMES) :].any()
    if name in _PLACE:
        more = "more" if off > 0 else "less"
        found = (
            f"{name} is {abs(off):.2f} m {more} than the hand reaches, {most:.2f} m is tolerated"
        )
        helps = "move the glass, or "
    elif name in _TURN:
        found = (
            f"{name} would leave the hand turned {abs(off):.2f} rad otherwise than shown, "
            f"{most:.2f} rad is tolerated"
        )
        helps = "stand the glass up, or "
    else:
        found, helps = f"{name} is {off:+.3f} off, {most:.3f} is tolerated", ""
    if not is_seen:
        found, helps = f"no glass is perceived (as zeros, {found})", "put one within reach, or "
    return f"{found}: {helps}show me"
