"""Where the hand turns from one landmark to the next, labelled by hand in ten demonstrations.

The labels were written down from the numbers of each step: the commands, the gripper, the distances
and how fast hand and object move. The cut that the library makes was not looked at before, and the
labels were not changed afterwards. The rule was what a person would say: the hand is on its way to
the object until it has it, and then on its way to where the object shall be. It has it at the first
command that carries, pulls or turns away from the approach; where the hand pushes on without a new
command, at the first step at which the object moves.
"""

from __future__ import annotations

from itertools import pairwise

LABELS: dict[str, tuple[tuple[int, str], ...]] = {
    "drawer-open": ((0, "object"), (65, "goal")),
    "button-press-topdown": ((0, "object"), (54, "goal")),
    "pick-place": ((0, "object"), (28, "goal")),
    "hammer": ((0, "object"), (24, "object2"), (63, "goal")),
    "peg-insert-side": ((0, "object"), (50, "goal")),
    "coffee-push": ((0, "object"), (41, "goal")),
    "basketball": ((0, "object"), (49, "goal")),
    "assembly": ((0, "object"), (30, "goal")),
    "push": ((0, "object"), (37, "goal")),
    "door-lock": ((0, "object"), (44, "goal"), (54, "object"), (114, "goal")),
}
"""Task -> the frame at which the hand sets out for a landmark, and that landmark, in the first
episode of draw 0. In door-lock the hand pushes the lock, backs away and comes down on it again."""


def labelled(task: str, steps: int) -> list[str]:
    """Return the landmark of each of `steps` frames of a task's labelled demonstration."""
    starts = [*LABELS[task], (steps, "")]
    return [name for (at, name), (end, _) in pairwise(starts) for _ in range(end - at)]
