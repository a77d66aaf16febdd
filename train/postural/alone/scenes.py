"""The scenes in which learners act: with a demonstrator or without, at places near and far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from envs.glass_offset import draw_within

RADIUS = 0.15  # [m] from the place of the demonstrations; uniform in area, `draw_within`

OURS, OURS_ONE = "ours", "ours, one demonstration"
PACNET, COPYING = "PACNet, which watches", "copying the demonstrator"
REPLAY, NEAREST, UNFRAMED = (
    "replay of the nearest",
    "1-NN over all frames",
    "no frames of reference",
)
ROWS = (OURS, OURS_ONE, PACNET, COPYING, REPLAY, NEAREST, UNFRAMED)


@dataclass(frozen=True)
class Scene:
    """One kind of episodes, and who acts in them.

    Attributes:
        rows: Of ROWS.
        demonstrator: One of `envs.presence.PRESENCES`.
        radius: Largest distance of the glasses from the usual place [m], which itself differs by
            1 cm in each direction.
        own_glass: One of `envs.own_glass.OWN_GLASSES`.
    """

    rows: tuple[str, ...]
    demonstrator: str = "absent"
    radius: float = RADIUS
    own_glass: str = "standing"

    @property
    def is_known(self) -> bool:
        """Return whether the imitator's glass stands within reach."""
        return self.own_glass == "standing"

    def options(self, seed: int) -> dict[str, Any]:
        """Return the options of `reset` for an episode; its seed decides where the glasses are."""
        return {
            "demonstrator": self.demonstrator,
            "own_glass": self.own_glass,
            "glass_offset": draw_place(seed, self.radius),
        }


_ALONE = (OURS, OURS_ONE, REPLAY, NEAREST, UNFRAMED)
_WATCHING = (PACNET, COPYING)
USUAL = "alone, ± 1 cm"
ALONE = "alone, 15 cm"
LEAVES = "left after 1 s, 15 cm"
PRESENT = "present, 15 cm"
SCENES = {
    USUAL: Scene(_ALONE, radius=0.0),
    ALONE: Scene((*_ALONE, COPYING)),
    LEAVES: Scene((OURS, COPYING), "leaves"),
    PRESENT: Scene(_WATCHING, "present"),
    "present, ± 1 cm": Scene(_WATCHING, "present", radius=0.0),
}
STRANGE = {kind: Scene((OURS,), own_glass=kind) for kind in ("far", "tipped", "absent")}


def draw_place(seed: int, radius: float) -> tuple[float, float]:
    """Return the offset [m] of the glasses in the episodes of a seed."""
    x, y = draw_within(np.random.default_rng(seed), radius).tolist()
    return x, y


def scenes_of(radius: float) -> dict[str, Scene]:
    """Return the scenes whose glasses stand within a radius [m], by their names."""
    return {name: scene for name, scene in (SCENES | STRANGE).items() if scene.radius == radius}
