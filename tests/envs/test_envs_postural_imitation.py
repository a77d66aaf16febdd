"""The scene of Experiment 1: what demonstrator, imitator, hands and glasses do."""

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs.humanoid import JOINTS
from envs.kinematics import BodyKinematics
from envs.postural_imitation import GLASS_NAMES, STATE_NAMES, percept

ENV_ID = "pacnet/PosturalImitation-v0"
RIGHT_SHOULDER_RZ = JOINTS.index("right_shoulder_rz")


@pytest.fixture(scope="module")
def noiseless():
    env = gymnasium.make(ENV_ID, noise_scale=0.0).unwrapped
    yield env
    env.close()


def play(env, policy, seed):
    """Run an episode; `policy` is called with the environment before each step."""
    observation, info = env.reset(seed=seed)
    records, truncated = [(observation, info)], False
    while not truncated:
        observation, _, terminated, truncated, info = env.step_to(policy(env))
        assert not terminated
        records.append((observation, info))
    return records


def copy_demonstrator(env):
    return env.demonstrator_target


def watch(env):
    return env.rest_posture


def wrist_errors(records):
    return np.array(
        [np.linalg.norm(i["imitator_wrist"] - i["demonstrator_wrist"]) for _, i in records]
    )


def play_until(env, phase, seed, policy=copy_demonstrator):
    """Play until the demonstrator is in the middle of a phase; return the last info."""
    _, info = env.reset(seed=seed)
    while info["phase"] != phase:
        info = env.step_to(policy(env))[-1]
    for _ in range(25):
        info = env.step_to(policy(env))[-1]
    return info


def check_demonstrator(env, seeds):
    for seed in seeds:
        assert play(env, watch, seed)[-1][1]["demonstrator_success"], seed


def test_the_demonstrator_drinks_and_puts_the_glass_back(noiseless):
    check_demonstrator(noiseless, range(20))


@pytest.mark.slow
def test_the_demonstrator_drinks_and_puts_the_glass_back_on_a_hundred_seeds(noiseless):
    check_demonstrator(noiseless, range(100, 200))


@pytest.mark.slow
@pytest.mark.parametrize("pace", [0.75, 1.25])
def test_the_demonstrator_succeeds_at_other_paces(pace):
    env = gymnasium.make(ENV_ID, pace=pace).unwrapped
    check_demonstrator(env, range(10))
    env.close()


@pytest.mark.parametrize("seed", range(4))
def test_an_imitator_with_the_true_targets_succeeds(noiseless, seed):
    records = play(noiseless, copy_demonstrator, seed)
    assert records[-1][1]["is_success"]
    errors = wrist_errors(records)[25:]  # it starts in its own rest posture
    assert errors.max() < 0.005
    assert errors.mean() < 0.001


def test_success_comes_only_with_the_glass_let_go(noiseless):
    held = []

    def copy_and_note(env):
        held.append(env._physics.grips[1].held)
        return env.demonstrator_target

    records = play(noiseless, copy_and_note, 0)
    phases = [info["phase"] for _, info in records]
    success = [info["is_success"] for _, info in records]
    reached = [info["mouth_reached"] for _, info in records]
    assert not any(reached[: phases.index("lift") + 1])
    assert all(reached[phases.index("drink") :])
    assert not any(success[: phases.index("put") + 1])
    assert all(success[phases.index("release") :])
    assert not np.any(np.logical_and(success[:-1], held))


def test_phases_come_in_order(noiseless):
    phases = [info["phase"] for _, info in play(noiseless, watch, 1)]
    order = [phase for i, phase in enumerate(phases) if i == 0 or phase != phases[i - 1]]
    carried = ["lift", "drink", "put"]
    assert order == ["rest", "approach", "grasp", *carried, "release", "withdraw", "rest"]


def test_the_hand_does_not_drag_the_glass_while_it_approaches(noiseless):
    for seed in range(3):
        records = play(noiseless, copy_demonstrator, seed)
        moved = [i["glass_from_place"] for _, i in records if i["phase"] in ("approach", "grasp")]
        assert max(moved) < 0.004


def test_a_watching_imitator_leaves_its_glass_alone(noiseless):
    records = play(noiseless, watch, 0)
    start, end = records[0][1], records[-1][1]
    assert np.allclose(start["glass_position"], end["glass_position"], atol=1e-3)
    assert end["glass_tilt"] < 1e-3
    assert not end["mouth_reached"]
    assert not end["is_success"]


def test_a_hand_that_passes_aside_misses_the_glass(noiseless):
    def aside(env):
        target = env.demonstrator_target
        target[RIGHT_SHOULDER_RZ] -= 0.3  # some 10 cm at the hand
        return target

    records = play(noiseless, aside, 0)
    grasp = [i for _, i in records if i["phase"] == "grasp"][-1]
    assert 0.08 < np.linalg.norm(grasp["imitator_wrist"] - grasp["demonstrator_wrist"]) < 0.15
    end = records[-1][1]
    assert end["glass_from_place"] < 1e-3
    assert end["glass_tilt"] < 1e-3
    assert end["demonstrator_success"]
    assert not end["is_success"]


def test_a_glass_let_go_in_the_air_falls(noiseless):
    info = play_until(noiseless, "drink", seed=0)
    held_at = info["glass_position"][2]
    noiseless.release("imitator")
    for _ in range(40):
        info = noiseless.step_to(noiseless.demonstrator_target)[-1]
    assert info["glass_position"][2] < held_at - 0.2
    truncated = False
    while not truncated:
        *_, truncated, info = noiseless.step_to(noiseless.demonstrator_target)
    assert not info["is_success"]
    assert info["demonstrator_success"]


def test_grip_and_hand_are_those_of_the_kinematics(noiseless):
    body = BodyKinematics()
    rng = np.random.default_rng(0)
    _, info = noiseless.reset(seed=0)
    for _ in range(30):
        pose = body.pose(info["imitator_angles"])
        assert np.abs(info["imitator_grip"] - pose.grip).max() < 1e-6
        assert info["imitator_hand"].shape == (3, 3)
        assert np.abs(info["imitator_hand"] - pose.hand).max() < 1e-6
        info = noiseless.step_to(rng.uniform(*body.joint_range.T))[-1]
    assert np.linalg.norm(info["imitator_grip"] - info["demonstrator_wrist"]) > 0.1


def test_an_action_is_a_share_of_the_joint_ranges(noiseless):
    for action, bound in ((-1.0, 0), (1.0, 1), (0.0, 0.5)):
        noiseless.reset(seed=0)
        by_share = noiseless.step(np.full(11, action, np.float32))[-1]["imitator_angles"]
        noiseless.reset(seed=0)
        low = noiseless.observation_space["proprioception"].low[:11] + 0.2
        high = noiseless.observation_space["proprioception"].high[:11] - 0.2
        angles = low + bound * (high - low)
        by_angle = noiseless.step_to(angles)[-1]["imitator_angles"]
        assert np.allclose(by_share, by_angle, atol=1e-5)


def test_angles_given_as_an_action_are_refused(noiseless):
    noiseless.reset(seed=0)
    with pytest.raises(ValueError, match=r"within \[-1, 1\].*step_to"):
        noiseless.step(noiseless.rest_posture)


@pytest.mark.parametrize("angles", [np.zeros(10), np.full(11, np.nan), "left", None])
def test_bad_angles_are_refused(noiseless, angles):
    noiseless.reset(seed=0)
    with pytest.raises(ValueError, match="angles must be 11 finite numbers"):
        noiseless.step_to(angles)


def test_release_refuses_unknown_names(noiseless):
    with pytest.raises(ValueError, match=r"demonstrator.*imitator.*'waiter'"):
        noiseless.release("waiter")


def test_both_glasses_have_the_same_offset_in_their_own_frames(noiseless):
    places = []
    for seed in range(20):
        observation, info = noiseless.reset(seed=seed)
        assert np.allclose(observation["glass"][:3], info["glass_position"], atol=1e-6)
        places.append(info["glass_position"][:2])
    spread = np.ptp(places, axis=0)
    assert (spread > 0.01).all()
    assert (spread <= 0.02).all()


def test_pace_shortens_the_demonstration():
    lengths = []
    for pace in (1.0, 1.25):
        env = gymnasium.make(ENV_ID, pace=pace).unwrapped
        env.reset(seed=0)
        lengths.append(env.episode_steps)
        env.close()
    assert lengths[0] / lengths[1] == pytest.approx(1.25, rel=0.02)


def test_episodes_differ_in_length(noiseless):
    lengths = []
    for seed in range(20):
        noiseless.reset(seed=seed)
        lengths.append(noiseless.episode_steps * 0.02)
    assert 8.0 < min(lengths) < max(lengths) - 0.5
    assert max(lengths) < 13.0


def test_the_demonstrator_moves_smoothly(noiseless):
    noiseless.reset(seed=0)
    targets = [noiseless.demonstrator_target]
    for _ in range(noiseless.episode_steps - 1):
        noiseless.step_to(noiseless.rest_posture)
        targets.append(noiseless.demonstrator_target)
    velocity = np.diff(targets, axis=0) / 0.02
    acceleration = np.diff(velocity, axis=0) / 0.02
    assert 0.5 < np.abs(velocity).max() < 4.0  # [rad/s]
    assert np.abs(acceleration).max() < 20.0  # [rad/s^2]


def test_noise_has_the_stated_standard_deviations():
    noisy = gymnasium.make(ENV_ID).unwrapped
    observations = [o for o, _ in play(noisy, watch, 4)]
    quiet = gymnasium.make(ENV_ID, noise_scale=0.0).unwrapped
    truth = [o for o, _ in play(quiet, watch, 4)]
    for key, (split, *stds) in {
        "demonstrator": (11, 0.01, 0.05),
        "glass": (3, 0.005, 0.01),
        "proprioception": (11, 0.01, 0.05),
    }.items():
        error = np.array([o[key] - t[key] for o, t in zip(observations, truth, strict=True)])
        for part, std in zip(np.split(error, [split], axis=1), stds, strict=True):
            assert part.std() == pytest.approx(std, rel=0.1)
            assert abs(part.mean()) < 0.1 * std
    noisy.close()
    quiet.close()


def test_noise_scale_multiplies_the_noise():
    errors = []
    for scale in (1.0, 4.0):
        env = gymnasium.make(ENV_ID, noise_scale=scale).unwrapped
        observation, info = env.reset(seed=0)
        errors.append(observation["demonstrator"][:11] - info["demonstrator_angles"])
        env.close()
    assert np.allclose(errors[1], 4 * errors[0], atol=1e-5)


def test_the_demonstrators_state_is_perceived_in_the_order_of_the_names(noiseless):
    assert len(STATE_NAMES) == 22
    assert len(GLASS_NAMES) == 6
    noiseless.reset(seed=0)
    for _ in range(60):
        observation, _, _, _, info = noiseless.step_to(noiseless.rest_posture)
    assert np.allclose(observation["demonstrator"][:11], info["demonstrator_angles"], atol=1e-6)
    assert np.allclose(observation["proprioception"][:11], info["imitator_angles"], atol=1e-6)
    expected = np.concatenate([observation["demonstrator"], observation["glass"]])
    assert np.array_equal(percept(observation), expected)
    assert percept(observation).shape == (28,)
    assert percept(observation).dtype == np.float32


def test_perceived_velocities_are_the_rates_of_the_angles(noiseless):
    noiseless.reset(seed=0)
    states = [noiseless.step_to(noiseless.rest_posture)[0]["demonstrator"] for _ in range(80)]
    angles, velocities = np.split(np.array(states), 2, axis=1)
    rates = np.diff(angles, axis=0) / 0.02
    assert np.abs(rates - velocities[1:]).max() < 1e-3
    assert np.abs(rates).max() > 1.0


def test_the_glass_tilts_towards_the_face(noiseless):
    play_until(noiseless, "drink", seed=0)
    observation, _, _, _, info = noiseless.step_to(noiseless.demonstrator_target)
    rx, ry, rz = observation["glass"][3:]
    assert ry < -0.6  # a turn about the leftwards axis that brings the rim to the face
    assert rz == 0
    assert np.hypot(rx, ry) == pytest.approx(info["glass_tilt"], abs=0.05)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"pace": 0.0}, "pace"),
        ({"pace": float("nan")}, "pace"),
        ({"noise_scale": -1.0}, "noise_scale"),
        ({"noise_scale": float("inf")}, "noise_scale"),
        ({"width": 0}, "width"),
        ({"height": 5000}, "height"),
        ({"behaviour": "eat"}, r"behaviour must be one of .*'drink', 'toast', 'move'.* got 'eat'"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        gymnasium.make(ENV_ID, **arguments)
