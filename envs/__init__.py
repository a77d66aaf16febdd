"""Scenes of the two experiments as gymnasium environments over dm_control.

Importing this package registers ``pacnet/PosturalImitation-v0`` (Experiment 1) and
``pacnet/WallFollowing-v0`` (Experiment 2).
"""

import gymnasium

from envs.gl import choose_gl

choose_gl()  # before any import of dm_control, which reads the choice once

gymnasium.register(
    id="pacnet/PosturalImitation-v0",
    entry_point="envs.postural_imitation:PosturalImitationEnv",
)
gymnasium.register(
    id="pacnet/WallFollowing-v0",
    entry_point="envs.wall_following:WallFollowingEnv",
    max_episode_steps=2500,
)
