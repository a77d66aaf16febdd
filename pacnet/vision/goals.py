"""Where the hand will be: the labels that every demonstration brings along."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SHARES = (0.25, 0.5, 0.75, 1.0)
"""Of a demonstration's time; where the hand is then are its goals."""


_ABOUT = 0.06  # [s] before and after a moment, of which the mean is taken: percepts are noisy


def goals_of(hand: NDArray[np.floating], fps: float) -> NDArray[np.float32]:
    """Return the goals of a demonstration, `[G · S]`, one after the other.

    Args:
        hand: where it is in each frame, `[T ≥ 1, S]`: a place, or a posture of joints.
        fps: frames per second [1/s].
    """
    moments = [round(share * (len(hand) - 1)) for share in SHARES]
    about = round(_ABOUT * fps)
    goals = [hand[max(0, one - about) : one + about + 1].mean(axis=0) for one in moments]
    return np.concatenate(goals).astype(np.float32)


def goal_names(hand: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the dimensions of the goals, from those of the hand's S dimensions."""
    return tuple(f"{goal_name(number)}.{name}" for number in range(len(SHARES)) for name in hand)


def goal_name(number: int) -> str:
    """Return what to call a goal: the place where the hand will be when so much is over."""
    return f"goal {SHARES[number]:.0%}"
