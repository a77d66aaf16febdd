"""Experiment 2: the robot's sensors and wheels, and the environment's measures."""

import dataclasses
import math

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs.arena import Arena, Box, Pillar, make_arena
from envs.arena_physics import ArenaPhysics
from envs.arena_scene import CONTROL_TIMESTEP
from envs.khepera import (
    INFRARED_ANGLES,
    INFRARED_NAMES,
    MAX_WHEEL_SPEED,
    RADIUS,
    RAY_ANGLES,
    REACH,
    WHEEL_BASE,
    infrared,
)
from envs.wall_behaviours import CRUISE, WALL_DISTANCE
from envs.wall_following import WallFollowingEnv

ENV_ID = "pacnet/WallFollowing-v0"
EAST_WALL = 0.6  # [m] x of the inner face of the paper's arena
GIVE = 0.01  # of the way made, by which the lateral servo yields to the force in a curve


@pytest.fixture(scope="module")
def open_field():
    """A robot with no wall near."""
    physics = ArenaPhysics.build(Arena((4.0, 4.0)), ("learner",))
    yield physics
    physics.free()


@pytest.fixture(scope="module")
def env():
    made = gymnasium.make(ENV_ID, noise_scale=0.0).unwrapped
    yield made
    made.close()


def put(env, x, y, heading):
    """Put the learner somewhere at rest."""
    env.reset(seed=0)
    env._physics.begin(np.array([[x, y, heading]]))


def beside_east_wall(env, distance=WALL_DISTANCE, heading=math.pi / 2):
    put(env, EAST_WALL - RADIUS - distance, 0.0, heading)


def drive(physics, wheels, n_steps):
    """Poses (n_steps + 1, 3) of the learner once its wheels turn steadily."""
    physics.begin(np.zeros((1, 3)))
    physics.advance(np.array([wheels]))
    poses = [physics.poses[0]]
    for _ in range(n_steps):
        physics.advance(np.array([wheels]))
        poses.append(physics.poses[0])
    return np.array(poses)


def reading_at(distance):
    return infrared(np.full((6, 3), distance))[0]


def mirrored(obstacle):
    """The obstacle on the other side of the x axis."""
    centre = (obstacle.centre[0], -obstacle.centre[1])
    if isinstance(obstacle, Pillar):
        return dataclasses.replace(obstacle, centre=centre)
    return Box(centre, obstacle.half_size, -obstacle.angle)


# Sensors


def test_a_reading_is_one_at_contact_and_zero_beyond_reach():
    assert reading_at(0.0) == pytest.approx(1.0)
    assert reading_at(REACH) > 0
    assert reading_at(REACH + 1e-6) == 0
    assert reading_at(-1.0) == 0  # MuJoCo's word for a ray that hits nothing


def test_a_reading_falls_with_distance():
    readings = np.array([reading_at(d) for d in np.linspace(0, REACH, 50)])
    assert (np.diff(readings) < 0).all()
    assert reading_at(0.03) == pytest.approx(0.5 * (1 + math.exp(-3)))  # half of the sigmoid's top


def test_three_rays_are_averaged():
    distances = np.full((6, 3), -1.0)
    distances[4] = (0.0, 0.03, 0.2)
    expected = (1.0 + 0.5 * (1 + math.exp(-3)) + 0.0) / 3
    np.testing.assert_allclose(infrared(distances), [0, 0, 0, 0, expected, 0])


def test_sensors_before_a_flat_wall_by_trigonometry(open_field):
    gap = 0.02  # [m] from the rim ahead to the wall at x = 2
    open_field.begin(np.array([[2.0 - RADIUS - gap, 0.3, 0.0]]))
    expected = np.full((6, 3), -1.0)
    for sensor, angle in enumerate(INFRARED_ANGLES):
        start = RADIUS * math.cos(angle)  # ahead of the robot's middle
        for ray, turn in enumerate(RAY_ANGLES):
            slope = math.cos(angle + turn)
            if slope > 1e-6:
                expected[sensor, ray] = (RADIUS + gap - start) / slope
    np.testing.assert_allclose(open_field.infrared(0), infrared(expected), atol=1e-9)
    assert open_field.infrared(0)[2] > 0.6


@pytest.mark.parametrize("which", ["paper", 0, 3])
def test_a_mirrored_world_gives_mirrored_readings(which):
    arena = make_arena(which)
    reflected = Arena(
        arena.size, tuple(map(mirrored, arena.inner_walls)), tuple(map(mirrored, arena.islands))
    )
    here, there = (ArenaPhysics.build(each, ("learner",)) for each in (arena, reflected))
    rng, n_seen = np.random.default_rng(0), 0
    while n_seen < 20:
        x, y = rng.uniform(-0.5, 0.5, size=2) * arena.size
        turn = rng.uniform(-math.pi, math.pi)
        if arena.clearance([(x, y)])[0] < RADIUS:
            continue
        here.begin(np.array([[x, y, turn]]))
        there.begin(np.array([[x, -y, -turn]]))
        np.testing.assert_allclose(here.infrared(0), there.infrared(0)[::-1], atol=1e-9)
        n_seen += here.infrared(0).any()
    for physics in (here, there):
        physics.free()


def test_each_sensor_looks_where_its_name_says(open_field):
    """The robot turns so that one sensor after the other faces the wall."""
    for sensor, name in enumerate(INFRARED_NAMES):
        side, degrees = name.split("_")
        turn = -math.radians(float(degrees)) * (1 if side == "left" else -1)
        open_field.begin(np.array([[2.0 - RADIUS - 0.01, 0.0, turn]]))
        assert open_field.infrared(0).argmax() == sensor


# Wheels


def test_equal_wheels_drive_straight(open_field):
    poses = drive(open_field, (0.06, 0.06), n_steps=20)
    np.testing.assert_allclose(poses[-1] - poses[0], (0.06 * 2.0, 0.0, 0.0), atol=0.01 * 0.12)


def test_opposite_wheels_turn_in_place(open_field):
    poses = drive(open_field, (-0.03, 0.03), n_steps=20)
    assert poses[-1, 2] - poses[0, 2] == pytest.approx(2 * 0.03 / WHEEL_BASE * 2.0, rel=0.01)
    assert np.linalg.norm(poses[:, :2], axis=1).max() < 1e-6


@pytest.mark.parametrize("wheels", [(0.04, 0.08), (0.08, 0.04), (0.0, 0.06), (-0.05, -0.03)])
def test_unequal_wheels_drive_a_circle(open_field, wheels):
    """From any pose, after t: x += r (sin(h + w t) - sin h), y -= r (cos(h + w t) - cos h)."""
    left, right = wheels
    turn = (right - left) / WHEEL_BASE  # [rad/s]
    radius = (right + left) / 2 / turn  # [m]
    poses = drive(open_field, wheels, n_steps=20)
    heading, later = poses[0, 2], poses[0, 2] + turn * 2.0
    expected = [
        radius * (math.sin(later) - math.sin(heading)),
        -radius * (math.cos(later) - math.cos(heading)),
        turn * 2.0,
    ]
    made = poses[-1] - poses[0]
    way = abs(radius * turn * 2.0)  # [m]
    assert np.linalg.norm(made[:2] - expected[:2]) < GIVE * way
    assert np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum() == pytest.approx(
        way, rel=0.01
    )
    assert made[2] == pytest.approx(expected[2], rel=0.001)


def test_wheels_hardly_slip_sideways(open_field):
    poses = drive(open_field, (0.04, 0.08), n_steps=60)
    moved = np.diff(poses[:, :2], axis=0)
    heading = (poses[:-1, 2] + poses[1:, 2]) / 2  # that of the chord of an arc
    sideways = moved[:, 1] * np.cos(heading) - moved[:, 0] * np.sin(heading)
    assert np.abs(sideways).max() < GIVE * 0.006


def test_actions_are_shares_of_the_greatest_wheel_speed(env):
    put(env, 0.1, 0.1, 0.3)
    by_share = env.step(np.array([0.25, -0.5], np.float32))[-1]["pose"]
    put(env, 0.1, 0.1, 0.3)
    by_speed = env.step_to(np.array([0.25, -0.5]) * MAX_WHEEL_SPEED)[-1]["pose"]
    assert by_share.tolist() == by_speed.tolist()


def test_wheel_speeds_are_clipped(env):
    put(env, 0.1, 0.1, 0.3)
    fast = env.step_to([9.0, 9.0])[-1]["pose"]
    put(env, 0.1, 0.1, 0.3)
    assert fast.tolist() == env.step_to([MAX_WHEEL_SPEED] * 2)[-1]["pose"].tolist()


def test_a_wall_stops_the_robot_and_is_a_contact(env):
    beside_east_wall(env, distance=0.02, heading=0.0)
    infos = [env.step_to([MAX_WHEEL_SPEED] * 2)[-1] for _ in range(20)]
    assert not infos[0]["contact"]
    assert all(info["contact"] for info in infos[5:])
    # Contacts are soft, and the wheels push with 20 N s/m x 0.12 m/s each.
    assert -0.003 < infos[-1]["wall_distance"] < 0
    assert env.step_to([-0.06, -0.06])[-1]["wall_distance"] > 0.003
    assert not env.step_to([0.0, 0.0])[-1]["contact"]


def test_a_teacher_can_be_touched():
    env = gymnasium.make(ENV_ID, teacher="left").unwrapped
    env.reset(seed=0)
    env._physics.begin(np.array([[0.0, 0.2, 0.0], [2 * RADIUS + 0.005, 0.2, math.pi]]))
    contacts = [env.step_to([0.06, 0.06])[-1]["contact"] for _ in range(4)]
    env.close()
    assert contacts[-1]


# What is said about walls


@pytest.mark.parametrize(("heading", "side"), [(math.pi / 2, -1), (-math.pi / 2, 1)])
def test_wall_side_is_the_robots_own(env, heading, side):
    beside_east_wall(env, heading=heading)
    info = env.step_to([0.0, 0.0])[-1]
    assert info["wall_side"] == side
    assert info["wall_distance"] == pytest.approx(WALL_DISTANCE, abs=1e-6)


def test_a_wall_beyond_five_centimetres_is_on_no_side(env):
    sides = []
    for distance in (0.049, 0.051):
        beside_east_wall(env, distance)
        sides.append(env.step_to([0.0, 0.0])[-1]["wall_side"])
    assert sides == [-1, 0]


@pytest.mark.parametrize(
    ("heading", "share"),
    [(math.pi / 2, 1.0), (-math.pi / 2, 1.0), (math.pi, 0.0), (2.5, math.sin(2.5))],
    ids=["along", "along, other way", "away", "askew"],
)
def test_progress_is_the_way_along_the_wall(env, heading, share):
    beside_east_wall(env, 0.03, heading)
    env.step_to([CRUISE, CRUISE])
    progress = env.step_to([CRUISE, CRUISE])[-1]["progress"]
    assert progress == pytest.approx(share * CRUISE * CONTROL_TIMESTEP, abs=2e-5)


def test_turning_in_place_is_no_progress(env):
    beside_east_wall(env)
    _, reward, _, _, info = env.step_to([-0.04, 0.04])
    assert info["progress"] < 1e-9
    assert reward < 1e-6


@pytest.mark.parametrize(
    ("distance", "speed", "expected"),
    [
        (0.026, 0.06, 1.0),
        (0.036, 0.06, math.exp(-0.5)),
        (0.016, 0.06, math.exp(-0.5)),
        (0.046, 0.06, math.exp(-2.0)),
        (0.026, 0.03, 0.5),
        (0.026, 0.12, 1.0),
        (0.026, -0.06, 1.0),
        (0.036, 0.03, 0.5 * math.exp(-0.5)),
    ],
)
def test_energy_by_hand(env, distance, speed, expected):
    """exp(-(10 mm off / 10 mm)² / 2) = e^-½; half the way at half the speed."""
    beside_east_wall(env, distance)
    env.step_to([speed, speed])
    reward = env.step_to([speed, speed])[1]
    assert isinstance(reward, float)
    assert reward == pytest.approx(expected, rel=0.01)


# Episodes


def test_without_noise_the_robot_perceives_the_truth(env):
    observation, _ = env.reset(seed=4, options={"wall": "left"})
    for _ in range(10):
        truth = env._physics.infrared(0).astype(np.float32)
        assert observation.tobytes() == truth.tobytes()
        observation = env.step_to([0.05, 0.06])[0]


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_noise_has_the_stated_deviation(scale):
    env = gymnasium.make(ENV_ID, noise_scale=scale).unwrapped
    env.reset(seed=0)
    env._physics.begin(np.array([[EAST_WALL - RADIUS - 0.02, 0.0, 0.0]]))
    readings = np.array([env.step_to([0.0, 0.0])[0] for _ in range(1_000)])
    truth = env._physics.infrared(0)
    env.close()
    seen = (truth > 0.1) & (truth < 0.9)  # clipping spares these
    assert seen.sum() >= 2
    np.testing.assert_allclose(readings[:, seen].std(axis=0), 0.01 * scale, rtol=0.08)
    np.testing.assert_allclose(readings[:, seen].mean(axis=0), truth[seen], atol=2e-3)


@pytest.mark.parametrize(("wall", "side"), [("left", 1), ("right", -1)])
def test_a_lone_learner_may_begin_beside_a_wall(env, wall, side):
    for seed in range(5):
        _, info = env.reset(seed=seed, options={"wall": wall})
        assert info["wall_side"] == side
        assert info["progress"] == 0
        assert "teacher_pose" not in info


def test_a_lone_learner_begins_in_the_open(env):
    for seed in range(5):
        _, info = env.reset(seed=seed)
        assert info["wall_distance"] >= 0.06
        assert info["wall_side"] == 0


@pytest.mark.parametrize("teacher", ["left", "right"])
def test_with_a_teacher_the_learner_begins_behind_it_in_the_open(teacher):
    env = gymnasium.make(ENV_ID, teacher=teacher, arena=2).unwrapped
    _, info = env.reset(seed=1)
    heading = np.array([math.cos(info["pose"][2]), math.sin(info["pose"][2])])
    ahead = info["teacher_pose"][:2] - info["pose"][:2]
    np.testing.assert_allclose(ahead, 0.13 * heading, atol=1e-12)
    assert info["wall_side"] == 0
    assert info["wall_distance"] >= 0.06
    before = info["teacher_pose"]
    after = env.step_to([0.0, 0.0])[-1]["teacher_pose"]
    assert np.linalg.norm(after[:2] - before[:2]) == pytest.approx(0.006, abs=0.001)
    env.close()


def test_gymnasium_ends_an_episode_after_2500_steps():
    env = gymnasium.make(ENV_ID)
    env.reset(seed=0)
    ends = [env.step(np.zeros(2, np.float32))[2:4] for _ in range(2_500)]
    env.close()
    assert ends == [(False, False)] * 2_499 + [(False, True)]


# Refusals


@pytest.mark.parametrize("options", [{"wall": "front"}, {"wal": "left"}, {"wall": "left", "x": 1}])
def test_unknown_options_are_refused_before_anything_is_reset(env, options):
    _, info = env.reset(seed=3)
    draws = env.np_random.bit_generator.state
    with pytest.raises(ValueError, match="options must be"):
        env.reset(seed=8, options=options)
    assert env.np_random.bit_generator.state == draws
    assert env._physics.poses[0].tolist() == info["pose"].tolist()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"render_mode": "human"}, "render_mode must"),
        ({"arena": "maze"}, "arena must"),
        ({"arena": -3}, "arena must"),
        ({"teacher": "ahead"}, "teacher must"),
        ({"noise_scale": -1.0}, "noise_scale must"),
        ({"noise_scale": math.nan}, "noise_scale must"),
        ({"camera": "side"}, "camera must"),
        ({"width": 0}, "width and height"),
        ({"height": 4_000}, "width and height"),
    ],
)
def test_wrong_arguments_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        WallFollowingEnv(**wrong)


@pytest.mark.parametrize(
    "action", [np.array([0.0, 1.1]), np.array([-2.0, 0.0]), np.zeros((2, 1)), np.zeros(3)]
)
def test_actions_beyond_the_space_are_refused(env, action):
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action must"):
        env.step(action)


def test_with_a_teacher_no_wall_can_be_chosen():
    env = gymnasium.make("pacnet/WallFollowing-v0", teacher="left").unwrapped
    with pytest.raises(ValueError, match="options must be empty with a teacher"):
        env.reset(seed=0, options={"wall": "right"})
    env.close()
