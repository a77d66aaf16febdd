"""Glasses at other places on the table: where they can stand, and what is done there."""

import math

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs.glass_offset import (
    CLEARANCE,
    DIRECTIONS,
    MAX_OFFSET,
    checked_offset,
    draw_offset,
    draw_within,
)
from envs.scene import GLASS_PLACE, GLASS_RADIUS, ROOT_DISTANCE, TABLE_HALF_SIZE

ENV_ID = "pacnet/PosturalImitation-v0"
DISTANCE = 0.15  # [m]


@pytest.fixture(scope="module")
def env():
    made = gymnasium.make(ENV_ID, noise_scale=0.0).unwrapped
    yield made
    made.close()


def begin(env, seed, offset=None):
    return env.reset(seed=seed, options=None if offset is None else {"glass_offset": offset})


def play(env, seed, offset):
    """The infos of an episode whose imitator is given the demonstrator's targets."""
    infos, truncated = [begin(env, seed, offset)[1]], False
    while not truncated:
        *_, truncated, info = env.step_to(env.demonstrator_target)
        infos.append(info)
    return infos


@pytest.mark.parametrize("offset", [(0.0, 0.1), (-0.15, 0.0), [0.0, -0.15], np.array((0.15, 0.0))])
def test_both_glasses_stand_away_by_the_offset(env, offset):
    observation, info = begin(env, 3)
    elsewhere, moved = begin(env, 3, offset)
    expected = np.array((*offset, 0.0))
    assert moved["glass_position"] - info["glass_position"] == pytest.approx(expected)
    away = elsewhere["glass"][:3] - observation["glass"][:3]
    assert away == pytest.approx(expected, abs=1e-6)


def test_without_an_offset_nothing_changes():
    env = gymnasium.make(ENV_ID).unwrapped
    runs = []
    for options in (None, {}, {"glass_offset": (0.0, 0.0)}):
        records = [env.reset(seed=5, options=options)[0]]
        records += [env.step_to(env.demonstrator_target)[0] for _ in range(30)]
        runs.append([value.tobytes() for record in records for value in record.values()])
    assert runs[0] == runs[1] == runs[2]
    env.close()


def test_an_offset_lasts_for_one_episode(env):
    usual = begin(env, 4)[1]["glass_position"]
    begin(env, 4, (-0.1, 0.0))
    assert np.array_equal(begin(env, 4)[1]["glass_position"], usual)


def test_a_mishap_can_happen_elsewhere_too(env):
    _, info = env.reset(seed=1000, options={"mishap": "miss", "glass_offset": (-0.1, -0.1)})
    place, truncated = info["glass_position"], False
    while not truncated:
        *_, truncated, info = env.step_to(env.rest_posture)
    assert not info["demonstrator_success"]
    assert np.allclose(info["glass_position"], place, atol=1e-3)


def check_successes(env, seeds):
    rng = np.random.default_rng(seeds[0])
    ends = [play(env, seed, draw_offset(rng, DISTANCE))[-1] for seed in seeds]
    assert sum(end["demonstrator_success"] for end in ends) >= 0.99 * len(ends)
    assert sum(end["is_success"] for end in ends) >= 0.98 * len(ends)


def test_a_drink_succeeds_there(env):
    check_successes(env, range(3))


@pytest.mark.slow
def test_a_hundred_drinks_succeed_there():
    env = gymnasium.make(ENV_ID).unwrapped
    check_successes(env, range(100))
    env.close()


def test_the_hand_has_the_glass_from_the_grasp_to_the_release(env):
    infos = play(env, 0, (-0.1, -0.1))
    held = {phase: [i["glass_held"] for i in infos if i["phase"] == phase] for phase in PHASES}
    assert not any(held["rest"] + held["withdraw"])
    assert all(held["lift"] + held["drink"])
    assert not infos[0]["glass_held"]


PHASES = ("rest", "approach", "grasp", "lift", "drink", "put", "release", "withdraw")


def test_drawn_offsets_have_the_length_and_the_directions_and_can_be_used():
    rng = np.random.default_rng(0)
    offsets = np.array([draw_offset(rng, DISTANCE) for _ in range(300)])
    assert np.linalg.norm(offsets, axis=1) == pytest.approx(DISTANCE)
    directions = np.arctan2(offsets[:, 1], offsets[:, 0]) % (2 * math.pi)
    low, high = DIRECTIONS
    assert low <= directions.min() < low + 0.1
    assert high - 0.1 < directions.max() <= high
    assert all(np.array_equal(checked_offset(offset), offset) for offset in offsets)
    assert np.array_equal(draw_offset(np.random.default_rng(0), DISTANCE), offsets[0])


def test_offsets_within_a_radius_are_uniform_in_area():
    rng = np.random.default_rng(0)
    offsets = np.array([draw_within(rng, DISTANCE) for _ in range(2000)])
    shares = (np.linalg.norm(offsets, axis=1) / DISTANCE) ** 2  # of the area within that distance
    assert shares.max() <= 1
    assert np.quantile(shares, (0.1, 0.5, 0.9)) == pytest.approx((0.1, 0.5, 0.9), abs=0.04)
    directions = np.arctan2(offsets[:, 1], offsets[:, 0]) % (2 * math.pi)
    middle = np.quantile(np.degrees(directions), (0.0, 0.5, 1.0))
    assert middle == pytest.approx((60.0, 157.5, 255.0), abs=5.0)
    assert np.array_equal(draw_within(np.random.default_rng(0), DISTANCE), offsets[0])
    assert np.array_equal(draw_within(rng, 0.0), np.zeros(2))


@pytest.mark.parametrize("radius", [-0.01, 0.17, math.nan])
def test_a_radius_beyond_the_arms_reach_is_refused(radius):
    with pytest.raises(ValueError, match=r"expected radius within 0 and 0\.16 m, got"):
        draw_within(np.random.default_rng(0), radius)


@pytest.mark.parametrize("offset", [(0.2, 0.0), (0.12, 0.07), "left"])
def test_a_refusal_says_where_glasses_can_stand(offset):
    """Beyond reach or off the table, in its middle, and no offset at all."""
    free = r"60 to 255 degrees counterclockwise from forwards, up to 0\.16 m away"
    with pytest.raises(ValueError, match=free):
        checked_offset(offset)


def test_the_longest_offset_stays_on_the_table():
    edge = ROOT_DISTANCE / 2 - TABLE_HALF_SIZE[0]  # [m] from the body
    nearest = GLASS_PLACE[0] - MAX_OFFSET - 0.01  # the glasses' spread
    assert nearest - GLASS_RADIUS > edge


def test_glasses_that_would_meet_are_refused():
    towards_the_middle = np.array((ROOT_DISTANCE / 2, 0.0)) - GLASS_PLACE
    with pytest.raises(ValueError, match=r"0\.06 m from the.* 0\.000 m from the middle"):
        checked_offset(towards_the_middle)
    away = towards_the_middle / np.linalg.norm(towards_the_middle)
    checked_offset(towards_the_middle - 1.01 * CLEARANCE * away)


@pytest.mark.parametrize(
    "offset",
    [None, 0.1, (0.1,), (0.1, 0.0, 0.0), "left", ("a", "b"), (math.nan, 0.0), (0.0, math.inf),
     (0.12, 0.12), {"x": 1}],
)  # fmt: skip
def test_an_invalid_offset_is_refused(env, offset):
    with pytest.raises(ValueError, match="expected glass_offset as"):
        env.reset(seed=0, options={"glass_offset": offset})
