"""What robots do unlearned: the teacher keeps to a wall, the learner follows the teacher."""

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs.khepera import MAX_WHEEL_SPEED, RADIUS, WHEEL_BASE, wheel_speeds
from envs.wall_behaviours import (
    CRUISE,
    DIAGONAL_TARGET,
    FRONT_LIMIT,
    GAP,
    MAX_TURN,
    SIDE_TARGET,
    TrailFollower,
    WallFollower,
)
from envs.wall_following import CONTROL_TIMESTEP

ENV_ID = "pacnet/WallFollowing-v0"
SIDES = ["left", "right"]
BAND = (0.008, 0.05)  # [m] from rim to wall within which progress counts


def left_readings(beside=SIDE_TARGET, diagonal=DIAGONAL_TARGET, front=0.0):
    """Of a robot with a wall at its left."""
    return np.array([beside, diagonal, front, 0.0, 0.0, 0.0])


def speed_and_turn(wheels):
    """Forwards [m/s] and to the left [rad/s]."""
    left, right = wheels
    return (left + right) / 2, (right - left) / WHEEL_BASE


def distance_between(info):
    return np.linalg.norm(info["teacher_pose"][:2] - info["pose"][:2])


def test_wheel_speeds_turn_back_into_speed_and_turn():
    assert wheel_speeds(0.05, 0.0).tolist() == [0.05, 0.05]
    np.testing.assert_allclose(speed_and_turn(wheel_speeds(0.03, 1.1)), (0.03, 1.1))


def test_at_its_targets_the_teacher_drives_straight_on():
    wheels = WallFollower("left").act(left_readings())
    np.testing.assert_allclose(wheels, (CRUISE, CRUISE), atol=1e-12)


@pytest.mark.parametrize(
    ("readings", "sign"),
    [
        (left_readings(beside=0.3), 1),
        (left_readings(diagonal=0.1), 1),
        (left_readings(beside=0.8), -1),
        (left_readings(diagonal=0.4), -1),
    ],
    ids=["wall far", "wall bends away", "wall near", "wall bends in"],
)
def test_the_teacher_turns_towards_a_far_wall_and_away_from_a_near_one(readings, sign):
    speed, turn = speed_and_turn(WallFollower("left").act(readings))
    assert speed == pytest.approx(CRUISE)
    assert sign * turn > 0.1


@pytest.mark.parametrize("sensor", [2, 3])
def test_before_an_obstacle_the_teacher_turns_in_place_away_from_its_wall(sensor):
    readings = left_readings()
    readings[sensor] = FRONT_LIMIT + 0.01
    speed, turn = speed_and_turn(WallFollower("left").act(readings))
    assert speed == pytest.approx(0.0)
    assert turn == pytest.approx(-MAX_TURN)


def test_left_and_right_are_mirror_images():
    left, right = WallFollower("left"), WallFollower("right")
    for readings in np.random.default_rng(0).uniform(size=(200, 6)):
        assert left.act(readings).tolist() == right.act(readings[::-1])[::-1].tolist()


def test_the_teacher_asks_for_no_more_than_wheels_can_do():
    teacher = WallFollower("left")
    for readings in np.random.default_rng(1).uniform(size=(200, 6)):
        assert np.abs(teacher.act(readings)).max() <= MAX_WHEEL_SPEED


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("arena", ["paper", 1])
def test_the_teacher_alone_keeps_a_wall_at_its_side(arena, side):
    env = gymnasium.make(ENV_ID, arena=arena).unwrapped
    teacher, n_steps = WallFollower(side), 1_500
    observation, info = env.reset(seed=0, options={"wall": side})
    infos = []
    for _ in range(n_steps):
        observation, _, _, _, info = env.step_to(teacher.act(observation))
        infos.append(info)
    env.close()
    along = sum(i["progress"] for i in infos if BAND[0] <= i["wall_distance"] <= BAND[1])
    assert along / (CRUISE * CONTROL_TIMESTEP * n_steps) > 0.8
    assert not any(i["contact"] for i in infos)
    sides = np.array([i["wall_side"] for i in infos])
    assert (sides == (1 if side == "left" else -1)).mean() > 0.95


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("arena", ["paper", 1])
def test_the_learner_follows_the_teacher_at_a_distance(arena, side):
    env = gymnasium.make(ENV_ID, arena=arena, teacher=side).unwrapped
    _, info = env.reset(seed=0)
    follower = TrailFollower(info["pose"][:2], info["teacher_pose"][:2])
    gaps, way = [], []
    for _ in range(600):
        _, _, _, _, info = env.step_to(follower.act(info["pose"], info["teacher_pose"][:2]))
        assert not info["contact"]
        gaps.append(distance_between(info))
        way.append((info["pose"][:2], info["teacher_pose"][:2]))
    env.close()
    assert min(gaps) > 2 * RADIUS + 0.015
    assert max(gaps) < GAP + 0.01
    own, leaders = np.array(way).transpose(1, 0, 2)
    off = [np.linalg.norm(leaders - place, axis=1).min() for place in own[100:]]
    assert np.mean(off) < 0.006  # on the teacher's trail, of a point every 6 mm
    made = np.linalg.norm(np.diff(own, axis=0), axis=1).sum()
    assert made > 0.75 * 600 * CRUISE * CONTROL_TIMESTEP


def drive(follower, pose, leader, n_steps):
    """Integrates a follower's own motion behind a leader that stands."""
    pose = np.array(pose, dtype=float)
    for _ in range(n_steps):
        speed, turn = speed_and_turn(follower.act(pose, leader))
        half = pose[2] + turn * CONTROL_TIMESTEP / 2
        pose += CONTROL_TIMESTEP * np.array([speed * np.cos(half), speed * np.sin(half), turn])
    return pose


def test_straight_behind_a_leader_at_the_gap_it_drives_straight():
    follower = TrailFollower(np.zeros(2), np.array([GAP, 0.0]))
    speed, turn = speed_and_turn(follower.act(np.zeros(3), np.array([GAP, 0.0])))
    assert speed == pytest.approx(CRUISE)
    assert turn == pytest.approx(0.0)


@pytest.mark.parametrize(("gap", "faster"), [(GAP + 0.02, True), (GAP - 0.02, False)])
def test_it_drives_faster_when_behind_and_slower_when_near(gap, faster):
    leader = np.array([gap, 0.0])
    speed, _ = speed_and_turn(TrailFollower(np.zeros(2), leader).act(np.zeros(3), leader))
    assert (speed > CRUISE) == faster


def test_a_leader_behind_its_back_makes_it_turn_in_place():
    leader = np.array([-GAP, 0.01])
    speed, turn = speed_and_turn(TrailFollower(np.zeros(2), leader).act(np.zeros(3), leader))
    assert speed == 0
    assert turn == pytest.approx(MAX_TURN)  # to the left, where the leader is


def test_it_takes_the_leaders_way_around_a_corner_and_not_the_short_cut():
    leader = np.array([GAP, 0.0])
    follower, pose = TrailFollower(np.zeros(2), leader), np.zeros(3)
    corner = np.concatenate(
        [np.linspace((GAP, 0), (0.3, 0), 30), np.linspace((0.3, 0), (0.3, 0.3), 60)]
    )
    off = []
    for leader in corner:
        pose = drive(follower, pose, leader, n_steps=1)
        off.append(min(abs(pose[1]), abs(pose[0] - 0.3)))
    assert max(off) < 0.02
    assert pose[1] > 0.1  # it is around
