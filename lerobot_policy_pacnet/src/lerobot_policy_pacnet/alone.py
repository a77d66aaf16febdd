"""The scene of the first experiment with nobody to imitate: only the glass calls for a drink."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from lerobot_policy_pacnet.scenes import PosturalScene

RADIUS = 0.15  # [m] from where the glass stands in demonstrations, within which it stands here


class AloneScene(PosturalScene):
    """A body alone with its glass, which stands up to 15 cm from where demonstrations had it.

    Observation: ``agent_pos`` (22,) its own perceived angles [rad] and velocities [rad/s],
    ``environment_state`` (6,) its own glass; in its own frame both are what `PosturalScene` shows
    of the demonstrator in the other's. Action and success are those of `PosturalScene`. An episode
    lasts 15 s.

    Args:
        behaviour: "drink", "toast" or "move".
        render_mode: None or "rgb_array".
        noise_scale: factor on the perceptual noise.
        picture_every: as of `Scene`.
    """

    perceived = {  # noqa: RUF012  as in `PosturalScene`
        "agent_pos": "proprioception",
        "environment_state": "own_glass",
    }

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode; the seed determines it, with the glass's place, uniform in area."""
        super(PosturalScene, self).reset(seed=seed, options=options)
        # PosturalScene has made envs importable.
        offset = import_module("envs.glass_offset").draw_within(self.np_random, RADIUS)
        own_seed = int(self.np_random.integers(2**31))
        alone = {"demonstrator": "absent", "glass_offset": offset}
        return self._named(self._begin(seed=own_seed, options=alone)), {"is_success": False}
