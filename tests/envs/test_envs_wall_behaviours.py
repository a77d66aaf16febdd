"""Built-in behaviours: the teacher keeps to a wall, the learner follows the teacher."""

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs.khepera import MAX_WHEEL_SPEED, RADIUS, WHEEL_BASE, wheel_speeds
from envs.wall_behaviours import (
    AVOID_DIAGONAL,
    AVOID_FRONT,
    CRUISE,
    DIAGONAL_TARGET,
    FRONT_LIMIT,
    GAP,
    MAX_TURN,
    SIDE_TARGET,
    TrailFollower,
    WallFollower,
    Wanderer,
)
from envs.wall_following import CONTROL_TIMESTEP

ENV_ID = "pacnet/WallFollowing-v0"
SIDES = ["left", "right"]
NOTHING = np.zeros(6)  # readings in the open
BAND = (0.008, 0.05)  # [m] from rim to wall within which progress counts


def left_readings(beside=SIDE_TARGET, diagonal=DIAGONAL_TARGET, front=0.0):
    """Of a robot with a wall at its left."""
    return np.array([beside, diagonal, front, 0.0, 0.0, 0.0])


def speed_and_turn(wheels):
    """Forwards [m/s] and to the left [rad/s]."""
    left, right = wheels
    return (left + right) / 2, (right - left) / WHEEL_BASE


def own_side(arena, pose):
    """Distance from the rim to the nearest wall [m], and its side: 1 left, -1 right."""
    wall = arena.nearest_wall(pose[None, :2])[0]
    to_the_left = np.cos(pose[2]) * wall[1] - np.sin(pose[2]) * wall[0]
    return np.linalg.norm(wall) - RADIUS, np.sign(to_the_left)


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


def test_the_teacher_stays_within_the_wheels_speeds():
    teacher = WallFollower("left")
    for readings in np.random.default_rng(1).uniform(size=(200, 6)):
        assert np.abs(teacher.act(readings)).max() <= MAX_WHEEL_SPEED


def test_what_appears_ahead_makes_the_teacher_turn_away_before_it_must_turn_in_place():
    turns = []
    for front in (0.0, 0.1, 0.2, 0.3):
        speed, turn = speed_and_turn(WallFollower("left").act(left_readings(front=front)))
        assert speed == pytest.approx(CRUISE)
        turns.append(turn)
    # 6 rad/s per unit of reading, up to the most that a robot can do
    np.testing.assert_allclose(turns, [0.0, -0.6, -1.2, -MAX_TURN], atol=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_in_the_open_the_teacher_drives_straight(side):
    teacher = WallFollower(side)
    noise = np.random.default_rng(2).uniform(0, 0.05, size=(300, 6))
    for readings in noise:
        assert speed_and_turn(teacher.act(readings)) == pytest.approx((CRUISE, 0.0))


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_a_lost_wall_is_first_sought_on_its_side_and_then_straight_ahead(side, sign):
    teacher = WallFollower(side)
    seen = left_readings() if side == "left" else left_readings()[::-1]
    for _ in range(2):  # and again once it has found one
        teacher.act(seen)
        speeds, turns = zip(*(speed_and_turn(teacher.act(NOTHING)) for _ in range(60)), strict=True)
        np.testing.assert_allclose(speeds, CRUISE)
        np.testing.assert_allclose(turns[:29], sign * CRUISE / 0.048, rtol=0.01)  # at 4.8 cm
        np.testing.assert_allclose(turns[29:], 0.0, atol=1e-12)


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


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_the_teacher_finds_a_wall_on_its_side(side, sign):
    env = gymnasium.make(ENV_ID, teacher=side).unwrapped
    for seed in range(20):
        _, info = env.reset(seed=seed)
        follower = TrailFollower(info["pose"][:2], info["teacher_pose"][:2])
        for _ in range(150):
            info = env.step_to(follower.act(info["pose"], info["teacher_pose"][:2]))[-1]
        distance, on_side = own_side(env.arena, info["teacher_pose"])
        assert distance < 0.05, seed
        assert on_side == sign, seed
    env.close()


def test_every_episode_has_a_teacher_that_has_seen_no_wall_yet():
    """Else the one that lost a wall in the last episode would turn where it should drive on."""
    env = gymnasium.make(ENV_ID, teacher="left").unwrapped
    headings = []
    for _ in range(2):
        _, info = env.reset(seed=0)
        follower = TrailFollower(info["pose"][:2], info["teacher_pose"][:2])
        headings.append([])
        for _ in range(60):
            info = env.step_to(follower.act(info["pose"], info["teacher_pose"][:2]))[-1]
            headings[-1].append(info["teacher_pose"][2])
    env.close()
    assert headings[0] == headings[1]
    assert np.ptp(headings[0][:3]) < 1e-6  # straight on at first
    assert np.ptp(headings[0]) > 0.1  # then along a wall, which it remembers


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


def test_a_follower_beside_a_trail_is_back_on_it_soon():
    follower, pose = TrailFollower(np.zeros(2), np.array([GAP, 0.0])), np.array([0.0, 0.004, 0.0])
    for step in range(1, 6):  # 6 mm each
        pose = drive(follower, pose, np.array([GAP + 0.006 * step, 0.0]), n_steps=1)
    # Small offsets obey y'' + 2 y' / L + 2 y / L² = 0: e^-1.5 (cos 1.5 + sin 1.5) = 0.24 of 4 mm
    # are left after 3 cm with L = 2 cm, 0.51 of them with L = 3 cm.
    assert abs(pose[1]) < 0.001


# Wandering


class FixedDraws:
    """A generator whose draws are all the same: over 1/8 no run ever ends."""

    def __init__(self, value):
        self.value = value

    def random(self):  # noqa: D102
        return self.value

    def uniform(self, low, high):  # noqa: D102
        return low + self.value * (high - low)


def turns_of(wanderer, n_steps, readings=NOTHING):
    """Turns of a wanderer that always perceives the same [rad/s]."""
    return np.array([speed_and_turn(wanderer.act(readings))[1] for _ in range(n_steps)])


@pytest.mark.parametrize("arena", ["paper", 1])
def test_a_wanderer_turns_away_before_it_touches_anything(arena):
    env = gymnasium.make(ENV_ID, arena=arena).unwrapped
    wanderer, infos = Wanderer(np.random.default_rng(0)), []
    observation, _ = env.reset(seed=0)
    for _ in range(1_000):
        observation, _, _, _, info = env.step_to(wanderer.act(observation))
        infos.append(info)
    env.close()
    assert np.mean([info["contact"] for info in infos]) < 0.01
    assert np.mean([info["wall_side"] != 0 for info in infos]) > 0.1  # it did come near walls
    assert np.ptp([info["pose"][:2] for info in infos], axis=0).min() > 0.5  # and got about


def test_in_the_open_a_wanderer_holds_a_turn_for_a_while():
    wanderer = Wanderer(np.random.default_rng(0))
    wheels = [wanderer.act(NOTHING) for _ in range(8_000)]
    speeds, turns = np.array([speed_and_turn(pair) for pair in wheels]).T
    np.testing.assert_allclose(speeds, CRUISE)
    runs = 1 + np.count_nonzero(np.diff(turns))
    assert runs == pytest.approx(1_000, rel=0.1)  # each of 8 steps on average
    assert np.abs(turns).max() == pytest.approx(MAX_TURN, rel=0.05)
    # |turn| under half of the largest: a cube under 1/2, so a uniform number under 0.79
    assert (np.abs(turns) < MAX_TURN / 2).mean() == pytest.approx(0.5 ** (1 / 3), abs=0.06)
    assert abs(turns.mean()) < 0.1  # to neither side


def test_same_generator_same_turns_and_another_other_ones():
    one, same, other = (turns_of(Wanderer(np.random.default_rng(n)), 100) for n in (3, 3, 4))
    assert one.tobytes() == same.tobytes()
    assert one.tobytes() != other.tobytes()


@pytest.mark.parametrize(
    ("sensor", "reading", "sign"),
    [
        (1, AVOID_DIAGONAL, -1),
        (2, AVOID_FRONT, -1),
        (3, AVOID_FRONT, 1),
        (4, AVOID_DIAGONAL, 1),
    ],
)
def test_a_wanderer_turns_away_from_what_is_too_near_and_from_nothing_else(sensor, reading, sign):
    readings = NOTHING.copy()
    readings[sensor] = reading
    assert turns_of(Wanderer(FixedDraws(0.5)), 3, readings).tolist() == [0, 0, 0]
    readings[sensor] += 0.01
    speed, turn = speed_and_turn(Wanderer(FixedDraws(0.5)).act(readings))
    assert 0 < speed < CRUISE / 2
    assert turn == pytest.approx(sign * MAX_TURN)


def test_a_wanderer_does_not_oscillate_in_a_corner():
    wanderer = Wanderer(np.random.default_rng(0))
    left, right = np.array([0, 0, 0.9, 0.8, 0, 0]), np.array([0, 0, 0.8, 0.9, 0, 0])
    turns = [speed_and_turn(wanderer.act(readings))[1] for readings in (left, right) * 5]
    np.testing.assert_allclose(turns, -MAX_TURN)


def test_having_turned_away_a_wanderer_drives_straight_on_and_may_turn_the_other_way():
    wanderer = Wanderer(FixedDraws(0.5))
    wanderer.take_over(wheel_speeds(CRUISE, 0.7))
    assert turns_of(wanderer, 1, np.array([0, 0, 0.9, 0, 0, 0])) == pytest.approx([-MAX_TURN])
    assert turns_of(wanderer, 5).tolist() == [0.0] * 5
    assert turns_of(wanderer, 1, np.array([0, 0, 0, 0.9, 0, 0])) == pytest.approx([MAX_TURN])


@pytest.mark.parametrize("driven", [-1.3, 0.0, 0.4])
def test_a_wanderer_continues_a_motion_until_its_run_ends(driven):
    wanderer, alone = (Wanderer(np.random.default_rng(2)) for _ in range(2))
    before = turns_of(wanderer, 30), turns_of(alone, 30)
    np.testing.assert_array_equal(*before)
    wanderer.take_over(wheel_speeds(0.09, driven))
    turns, own = turns_of(wanderer, 60), turns_of(alone, 60)
    ends = np.flatnonzero(np.diff(own, prepend=before[1][-1]))[0]  # its own run ends there
    assert ends > 0
    np.testing.assert_allclose(turns[:ends], driven, atol=1e-12)
    np.testing.assert_array_equal(turns[ends:], own[ends:])


def test_a_wanderer_continues_a_motion_at_its_own_speed():
    wanderer = Wanderer(FixedDraws(0.5))
    wanderer.take_over(wheel_speeds(0.09, 0.4))
    assert speed_and_turn(wanderer.act(NOTHING)) == pytest.approx((CRUISE, 0.4))


def test_taking_over_ends_an_avoidance():
    wanderer = Wanderer(FixedDraws(0.5))
    assert turns_of(wanderer, 1, np.array([0, 0, 0.9, 0.0, 0, 0])) == pytest.approx([-MAX_TURN])
    wanderer.take_over(wheel_speeds(CRUISE, 0.0))
    assert turns_of(wanderer, 1, np.array([0, 0, 0.0, 0.9, 0, 0])) == pytest.approx([MAX_TURN])
