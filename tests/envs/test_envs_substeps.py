"""The substeps of a control step equal dm_control's, without Python between them."""

import mujoco
import numpy as np
import pytest
from dm_control.rl.control import PhysicsError

from envs import arena_scene, scene
from envs.arena import PAPER_ARENA
from envs.arena_physics import ArenaPhysics
from envs.behaviours import REST_POSTURE
from envs.physics import Physics
from envs.postural_imitation import PosturalImitationEnv
from envs.substeps import run_substeps

RESTING = np.stack([REST_POSTURE, REST_POSTURE])


def humanoids():
    physics = Physics.build()
    physics.begin(RESTING, np.array(scene.GLASS_PLACE))
    return physics, scene.N_SUBSTEPS


def arena():
    physics = ArenaPhysics.build(PAPER_ARENA, ("learner", "teacher"))
    physics.begin(np.array([[0.0, 0.3, 0.0], [0.3, 0.3, 1.0]]))
    return physics, arena_scene.N_SUBSTEPS


@pytest.fixture(params=[humanoids, arena], ids=lambda build: build.__name__)
def build(request):
    return request.param


def test_substeps_equal_those_of_dm_control(build):
    (ours, n_substeps), (theirs, _) = build(), build()
    rng = np.random.default_rng(0)
    at_rest = ours.data.ctrl.copy()
    for _ in range(60):
        ours.data.ctrl[:] = theirs.data.ctrl[:] = at_rest + rng.uniform(-0.1, 0.1, len(at_rest))
        run_substeps(ours, n_substeps)
        theirs.step(n_substeps)
        for name in ("time", "qpos", "qvel", "act", "site_xpos", "sensordata"):
            mine, other = (np.asarray(getattr(p.data, name)) for p in (ours, theirs))
            assert mine.tobytes() == other.tobytes(), name


def test_no_python_runs_in_the_substeps(build):
    build()
    hooks = [name for name in dir(mujoco) if name.startswith("get_mjcb_")]
    assert "get_mjcb_passive" in hooks
    assert {name: getattr(mujoco, name)() for name in hooks} == dict.fromkeys(hooks)


def test_a_diverging_simulation_raises(build):
    physics, n_substeps = build()
    run_substeps(physics, n_substeps)
    physics.data.qvel[0] = np.nan
    with pytest.raises(PhysicsError, match="warned"):
        run_substeps(physics, n_substeps)
    run_substeps(physics, n_substeps)  # MuJoCo has begun anew


def test_hands_let_go_at_the_start_of_an_episode():
    env = holding_env()
    env._physics.data.qvel[0] = np.nan
    with pytest.raises(PhysicsError):
        env.step_to(env.demonstrator_target)
    env.step_to(env.demonstrator_target)
    assert not any(grip.held for grip in env._physics.grips)
    assert not env._physics.data.eq_active.any()


def test_a_slip_is_measured_from_where_the_glass_was_taken():
    """Both glasses are pulled; the second way is by the poses of forearm and glass."""
    env = holding_env()
    physics = env._physics
    taken = [seen_from_forearm(physics, row) for row in (0, 1)]
    physics.data.xfrc_applied[physics._glasses, 1] = [30.0, 60.0]  # [N] sideways
    largest = np.zeros(2)
    for _ in range(10):
        env.step_to(env.demonstrator_target)
        slips = [np.linalg.norm(seen_from_forearm(physics, row) - taken[row]) for row in (0, 1)]
        if not all(grip.held for grip in physics.grips):
            break
        measured = physics._slips()
        np.testing.assert_allclose([measured[hold] for hold in physics._holds], slips, atol=1e-9)
        largest = np.maximum(largest, slips)
    assert largest[1] > 1.5 * largest[0] > 1e-4


def holding_env():
    """An environment in which both hands have just taken hold."""
    env = PosturalImitationEnv(noise_scale=0.0)
    env.reset(seed=0)
    assert env._physics._slips() == {}
    while not all(grip.held for grip in env._physics.grips):
        env.step_to(env.demonstrator_target)
    return env


def seen_from_forearm(physics, row):
    """A glass's middle in the frame of the forearm (3,) [m]."""
    data, arm = physics.data, physics._forearms[row]
    turn = data.xmat[arm].reshape(3, 3)
    return turn.T @ (data.xpos[physics._glasses[row]] - data.xpos[arm])
