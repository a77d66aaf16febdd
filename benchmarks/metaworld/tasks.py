"""Which tasks of Metaworld are run: those that methods may be tuned on, and those held out."""

from __future__ import annotations

from collections.abc import Sequence

DEVELOPMENT = (
    "reach", "button-press-topdown", "drawer-open", "pick-place", "door-open", "hammer",
    "peg-insert-side", "coffee-push", "window-close", "basketball", "sweep-into", "plate-slide",
    "faucet-open", "coffee-pull", "assembly",
)  # fmt: skip
HELD_OUT = (
    "box-close", "handle-pull", "push", "push-back", "lever-pull", "door-lock", "dial-turn",
    "soccer", "shelf-place",
)  # fmt: skip
OTHER = "other"
SETS: dict[str, tuple[str, ...]] = {"development": DEVELOPMENT, "held-out": HELD_OUT}
"""Name -> tasks. Any other task that Metaworld has belongs to `OTHER` and runs when named."""


def choose(names: Sequence[str]) -> tuple[str, ...]:
    """Return the tasks of some sets and the tasks named, each once, in the order given.

    Args:
        names: out of `SETS`, `OTHER` for all further tasks of Metaworld, or names of tasks, with
            or without a version, as in reach-v3.
    """
    chosen: dict[str, None] = {}
    for name in names:
        members = further() if name == OTHER else SETS.get(name, (name.removesuffix("-v3"),))
        chosen |= dict.fromkeys(members)
    return tuple(chosen)


def set_of(task: str) -> str:
    """Return the name of the set that a task belongs to."""
    return next((name for name, members in SETS.items() if task in members), OTHER)


def further() -> tuple[str, ...]:
    """Return the tasks of Metaworld that belong to no set; this imports Metaworld."""
    from benchmarks.metaworld.simulation import known_tasks

    return tuple(task for task in known_tasks() if set_of(task) == OTHER)
