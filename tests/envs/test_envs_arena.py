"""Walled arenas: geometry, random arenas, and initial poses of robots."""

import functools
import itertools
import math

import mujoco
import numpy as np
import pytest
from scipy.spatial.distance import cdist

from envs.arena import CLEARANCE, PAPER_ARENA, SIDES, Arena, Box, Pillar, generate_arena, make_arena
from envs.arena_physics import ArenaPhysics
from envs.khepera import RADIUS
from envs.placement import OPEN_CLEARANCE, following_poses, open_pose, wall_pose
from envs.wall_behaviours import GAP, WALL_DISTANCE

arena_of = functools.cache(make_arena)  # drawing one takes 35 ms

SPACING = 0.01  # [m] at most between two points of an outline
SEEDS = range(10)
MANY_SEEDS = range(200)
TOLERANCE = 0.006  # [m] by which a robot beside a wall may be off the distance that it keeps


def gap_between(one, other):
    """Between the outlines of two obstacles [m], too long by at most 0.1 mm beyond 0.25 m."""
    return cdist(one.outline, other.outline).min()


def heading_of(pose):
    return np.array([math.cos(pose[2]), math.sin(pose[2])])


def places_within(arena, count, seed):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, size=(count, 2)) * arena.size


@pytest.fixture(scope="module")
def drawn():
    """Arenas of the first 200 seeds."""
    return [generate_arena(seed) for seed in MANY_SEEDS]


def test_corners_of_a_turned_box_by_hand():
    box = Box((1.0, 2.0), (0.3, 0.1), angle=math.pi / 2)
    expected = {(0.9, 2.3), (0.9, 1.7), (1.1, 1.7), (1.1, 2.3)}
    assert {(round(x, 9), round(y, 9)) for x, y in box.corners} == expected


@pytest.mark.parametrize(
    "obstacle",
    [Box((0.1, -0.2), (0.2, 0.05), 0.7), Pillar((0.3, 0.1), 0.1), Pillar((0.0, 0.0), 0.01)],
    ids=["box", "pillar", "small pillar"],
)
def test_outline_goes_around_anticlockwise_in_short_steps(obstacle):
    steps = np.roll(obstacle.outline, -1, axis=0) - obstacle.outline
    assert np.linalg.norm(steps, axis=1).max() <= SPACING + 1e-12
    away = obstacle.outline - obstacle.centre
    turns = away[:, 0] * steps[:, 1] - away[:, 1] * steps[:, 0]
    assert (turns > 0).all()


def test_outer_walls_close_the_arena():
    walls = Arena((1.4, 1.0)).outer_walls
    corners = np.concatenate([wall.corners for wall in walls])
    np.testing.assert_allclose(corners.max(axis=0), (0.72, 0.52))
    np.testing.assert_allclose(corners.min(axis=0), (-0.72, -0.52))
    inside = {(round(abs(x), 9), round(abs(y), 9)) for x, y in corners}
    assert (0.7, 0.5) in inside  # the inner faces meet


def test_nearest_wall_by_hand():
    arena = Arena((1.0, 1.0), islands=(Pillar((0.0, 0.0), 0.1),))
    away = arena.nearest_wall([(0.4, 0.0), (0.0, -0.2), (0.45, 0.45), (0.2, 0.0)])
    np.testing.assert_allclose(away[:2], [(0.1, 0.0), (0.0, 0.1)], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(away[2]), 0.05)  # two walls are as near
    np.testing.assert_allclose(away[3], (-0.1, 0.0), atol=1e-12)


def test_nothing_is_clear_within_obstacles_or_outside():
    inside_island, inside_wall, outside = (-0.17, -0.17), (-0.2, 0.425), (0.9, 0.0)
    assert not PAPER_ARENA.clearance([inside_island, inside_wall, outside]).any()


@pytest.mark.parametrize("island", [Pillar((0.1, 0.1), 0.1), Box((0.1, 0.1), (0.1, 0.1), 0.4)])
def test_within_an_obstacle_the_nearest_point_is_the_place_itself(island):
    arena = Arena((1.0, 1.0), islands=(island,))
    place = np.array([[0.12, 0.15]])
    np.testing.assert_allclose(arena.nearest(place)[0, -1], place[0], atol=1e-12)
    assert arena.clearance(place)[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_nearest_wall_agrees_with_all_outline_points(which):
    arena = arena_of(which)
    places = places_within(arena, 400, seed=1)
    places = places[arena.clearance(places) > 1e-9]
    distance = np.linalg.norm(arena.nearest_wall(places), axis=1)
    brute = cdist(places, np.concatenate([item.outline for item in arena.obstacles])).min(axis=1)
    assert (distance <= brute + 1e-12).all()
    half = SPACING / 2 * np.sqrt(1 + distance / 0.06)  # around a pillar of 6 cm; less elsewhere
    assert (brute <= np.hypot(distance, half) + 1e-9).all()


@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_the_simulated_walls_stand_where_the_arena_says(which):
    """Distance of the nearest wall against MuJoCo's own between the robot's hull and each geom."""
    physics = ArenaPhysics.build(arena_of(which), ("learner",))
    model, data = physics.model.ptr, physics.data.ptr
    hull = physics.model.name2id("learner/hull", "geom")
    count = len(physics.arena.obstacles)
    walls = [physics.model.name2id(f"obstacle_{number}", "geom") for number in range(count)]
    rng = np.random.default_rng(2)
    for _ in range(10):
        physics.begin(open_pose(physics.arena, rng)[None])
        wall = physics.nearest_wall(0)
        simulated = min(mujoco.mj_geomDistance(model, data, hull, one, 3.0, None) for one in walls)
        assert wall.distance == pytest.approx(simulated, abs=1e-5)
        touched = physics.poses[0, :2] + (wall.distance + RADIUS) * wall.direction
        assert physics.arena.clearance(touched[None] + 1e-6 * wall.direction)[0] < 1e-5
    physics.free()


@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_obstacles_that_do_not_touch_leave_room_for_a_robot(which):
    obstacles = arena_of(which).obstacles
    gaps = [gap_between(one, other) for one, other in itertools.combinations(obstacles, 2)]
    apart = [gap for gap in gaps if gap > SPACING]
    least = CLEARANCE if which != "paper" else 0.2
    assert min(apart) >= least


@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_inner_walls_touch_one_outer_wall_and_islands_nothing(which):
    arena = arena_of(which)
    for wall in arena.inner_walls:
        assert sum(gap_between(wall, outer) < SPACING for outer in arena.outer_walls) == 1
    for island in arena.islands:
        others = [other for other in arena.obstacles if other is not island]
        assert min(gap_between(island, other) for other in others) > SPACING


@pytest.mark.slow
def test_every_seed_draws_walls_and_islands_within_bounds(drawn):
    for seed, arena in enumerate(drawn):
        assert 1 <= len(arena.inner_walls) <= 2, seed
        assert 1 <= len(arena.islands) <= 2, seed
        assert all(SIDES[0] <= side <= SIDES[1] for side in arena.size), seed
        for obstacle in (*arena.inner_walls, *arena.islands):
            assert (np.abs(obstacle.outline) <= np.array(arena.size) / 2 + 1e-9).all(), seed


@pytest.mark.slow
def test_seeds_draw_boxes_pillars_and_more_than_one_of_each(drawn):
    islands = [island for arena in drawn for island in arena.islands]
    assert {type(island) for island in islands} == {Box, Pillar}
    assert {len(arena.inner_walls) for arena in drawn} == {1, 2}
    assert {len(arena.islands) for arena in drawn} == {1, 2}


def test_same_seed_same_arena_and_other_seed_another():
    arenas = [arena_of(seed) for seed in SEEDS]
    assert [generate_arena(seed) for seed in SEEDS] == arenas
    assert len(set(arenas)) == len(arenas)


def test_arenas_by_name_and_by_seed():
    assert make_arena("paper") is PAPER_ARENA
    assert make_arena(np.int64(4)) == make_arena(4) == generate_arena(4)


@pytest.mark.parametrize("which", ["papers", -1, True, 1.0, None])
def test_other_arenas_are_refused(which):
    with pytest.raises(ValueError, match="arena must be 'paper' or a seed"):
        make_arena(which)


@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_robots_begin_in_the_open(which):
    arena, rng = arena_of(which), np.random.default_rng(3)
    poses = np.stack([open_pose(arena, rng) for _ in range(20)])
    assert (arena.clearance(poses[:, :2]) >= RADIUS + OPEN_CLEARANCE).all()
    assert np.ptp(poses[:, 2]) > math.pi  # any heading


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_robots_begin_along_a_wall_that_their_sensors_see(which, side):
    arena, rng = arena_of(which), np.random.default_rng(4)
    physics = ArenaPhysics.build(arena, ("learner",))
    for _ in range(20):
        pose = wall_pose(arena, rng, side)
        physics.begin(pose[None])
        assert physics.nearest_wall(0).distance == pytest.approx(WALL_DISTANCE, abs=TOLERANCE)
        left, right = physics.infrared(0)[[0, 5]]
        beside, opposite = (left, right) if side == "left" else (right, left)
        assert beside > 0.2  # at the end of a wall one of the three rays sees it
        assert opposite == 0
    physics.free()


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_one_robot_begins_straight_behind_another_with_the_way_between_open(which, side):
    arena, rng = arena_of(which), np.random.default_rng(5)
    for _ in range(20):
        behind, ahead = following_poses(arena, rng, side)
        np.testing.assert_allclose(ahead[:2] - behind[:2], GAP * heading_of(behind), atol=1e-12)
        assert ahead[2] == behind[2]
        way = np.linspace(behind[:2], ahead[:2], 50)
        assert arena.clearance(way[[0, -1]]).min() >= RADIUS + OPEN_CLEARANCE - 1e-12
        assert arena.clearance(way).min() >= RADIUS + OPEN_CLEARANCE - 1e-3  # checked at ten places


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
@pytest.mark.parametrize("which", ["paper", *SEEDS])
def test_the_robot_ahead_grazes_a_wall_on_the_wanted_side(which, side, sign):
    """Its heading is 25 degrees to a wall 7 cm beyond the distance that wall followers keep."""
    arena, rng = arena_of(which), np.random.default_rng(5)
    for _ in range(20):
        _, ahead = following_poses(arena, rng, side)
        to_the_wall = ahead[2] + sign * math.radians(90 - 25)
        way = np.array([math.cos(to_the_wall), math.sin(to_the_wall)])
        foot = ahead[:2] + (RADIUS + WALL_DISTANCE + 0.07) * way
        assert arena.clearance((foot - 1e-9 * way)[None])[0] < 1e-6


def test_same_generator_same_places():
    drawn = [
        (open_pose(PAPER_ARENA, rng), following_poses(PAPER_ARENA, rng, "left"))
        for rng in (np.random.default_rng(6), np.random.default_rng(6))
    ]
    for one, other in zip(*drawn, strict=True):
        assert one.tobytes() == other.tobytes()
