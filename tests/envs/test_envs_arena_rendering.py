"""Pictures of the arena, with and without OpenGL."""

import functools
import math
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs.arena import THICKNESS, make_arena
from envs.arena_drawing import RAY_FAR, RAY_NEAR, draw_arena, render_arena
from envs.arena_physics import ArenaPhysics
from envs.arena_scene import FLOOR, ISLAND, SKY, TOP_CAMERA_HEIGHT, WALL, WALL_HEIGHT
from envs.khepera import BODY_COLOURS, RADIUS, REACH

ENV_ID = "pacnet/WallFollowing-v0"
LEARNER, TEACHER = ([float(c) for c in BODY_COLOURS[name].split()] for name in BODY_COLOURS)
N_PIXELS = 600
SCALE = N_PIXELS / 1.26  # [pixels/m] of the paper's arena in a picture of that size
SIZES = [(360, 640), (480, 480)]
DRAW_IN_A_NEW_PROCESS = f"""
import gymnasium, envs
env = gymnasium.make("{ENV_ID}", render_mode="rgb_array", camera="chase", width=160, height=90)
env.reset(seed=0)
picture = env.render()
assert picture.shape == (90, 160, 3) and picture.dtype == "uint8", picture.shape
assert picture.std() > 20
print("drawn by", "OpenGL" if env.unwrapped.draws_with_gl else "Pillow")
"""


@functools.cache
def built(which, n_robots):
    return ArenaPhysics.build(make_arena(which), ("learner", "teacher")[:n_robots])


def physics_at(which, *poses):
    """Robots at rest at poses (x, y, heading) in an arena."""
    physics = built(which, len(poses))
    physics.begin(np.array(poses))
    return physics


def like(picture, colour, tolerance=0.1):
    """Which pixels have about this hue, however bright."""
    shades = picture / np.maximum(picture.max(axis=2, keepdims=True), 1)
    wanted = np.array(colour[:3]) / max(colour[:3])
    return (np.abs(shades - wanted).max(axis=2) < tolerance) & (picture.max(axis=2) > 40)


def exactly(picture, colour, tolerance=6):
    return np.abs(picture - 255.0 * np.array(colour[:3])).max(axis=2) < tolerance


def middle(mask):
    """Column and row."""
    assert mask.any()
    return np.argwhere(mask).mean(axis=0)[::-1]


def extent(mask):
    """First and last row, first and last column."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return rows[0], rows[-1], columns[0], columns[-1]


@pytest.fixture(params=["OpenGL", "Pillow"])
def draw(request):
    """Both ways to draw."""
    if request.param == "Pillow":
        return draw_arena
    if os.environ.get("MUJOCO_GL") == "disable":
        pytest.skip("no OpenGL here")
    return render_arena


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("which", ["paper", 0, 3])
def test_the_whole_arena_fills_the_picture_from_above(draw, which, size):
    physics = physics_at(which, (0.0, 0.3, 0.0))
    height, width = size
    first_row, last_row, first_column, last_column = extent(
        ~exactly(draw(physics, "top", *size), SKY)
    )
    margins = [first_row, height - 1 - last_row, first_column, width - 1 - last_column]
    assert min(margins) >= 1  # nothing is cut off
    assert min(max(margins[:2]), max(margins[2:])) <= 0.03 * height
    seen = (last_column + 1 - first_column) / (last_row + 1 - first_row)
    x, y = (side + 2 * THICKNESS for side in physics.arena.size)
    assert seen == pytest.approx(x / y, rel=0.01)


def test_from_above_things_are_where_they_are(draw):
    learner, teacher = (0.3, -0.1, 0.7), (0.1, 0.35, 0.0)
    physics = physics_at("paper", learner, teacher)
    picture = draw(physics, "top", 720, 720)
    rows = extent(~exactly(picture, SKY))[:2]
    scale = (rows[1] + 1 - rows[0]) / (1.2 + 2 * THICKNESS)  # [pixels/m]
    for colour, (x, y) in (
        (LEARNER, learner[:2]),
        (TEACHER, teacher[:2]),
        (ISLAND, (-0.17, -0.17)),
    ):
        expected = 359.5 + scale * np.array([x, -y])
        assert np.linalg.norm(middle(like(picture, colour)) - expected) < 0.01 * scale
    mask = like(picture, LEARNER)
    assert mask.sum() == pytest.approx(math.pi * (RADIUS * scale) ** 2, rel=0.25)  # less the nose


def test_walls_islands_and_floor_have_their_own_colours(draw):
    physics = physics_at("paper", (0.3, 0.0, 0.0))
    picture = draw(physics, "top", 480, 480)
    walls, islands, floor = (like(picture, c, 0.04).mean() for c in (WALL, ISLAND, FLOOR))
    closer = TOP_CAMERA_HEIGHT / (TOP_CAMERA_HEIGHT - WALL_HEIGHT)  # tops of walls look larger
    whole = (1.26 * closer) ** 2  # [m²] of floor, with a margin
    assert walls == pytest.approx(
        ((1.24 * closer) ** 2 - 1.2**2 + 2 * 0.35 * 0.02) / whole, rel=0.1
    )
    assert islands == pytest.approx((0.2 * closer) ** 2 / whole, rel=0.1)
    assert floor > 0.7


@pytest.mark.parametrize("heading", [1.0, -1.6])
def test_the_white_mark_points_ahead(draw, heading):
    physics = physics_at("paper", (0.3, 0.1, heading))
    picture = draw(physics, "top", N_PIXELS, N_PIXELS)
    centre = middle(like(picture, LEARNER))
    rows, columns = np.indices(picture.shape[:2])
    near = np.hypot(columns - centre[0], rows - centre[1]) < 0.022 * SCALE  # within the hull
    ahead = (middle((picture.min(axis=2) > 235) & near) - centre) * (1, -1)
    off = math.remainder(math.atan2(ahead[1], ahead[0]) - heading, math.tau)
    assert abs(off) < 0.15
    assert np.linalg.norm(ahead) > 5


def test_the_teacher_is_drawn_where_there_is_one(draw):
    alone, behind = physics_at("paper", (0.3, 0, 0)), physics_at("paper", (0.3, 0, 0), (0.45, 0, 0))
    for camera in ("top", "chase"):
        assert not like(draw(alone, camera, 240, 240), TEACHER).any()
        assert like(draw(behind, camera, 240, 240), TEACHER).any()


def test_rays_reach_as_far_as_the_sensors(draw):
    physics = physics_at("paper", (0.3, 0.1, math.pi / 2))
    picture = draw(physics, "top", N_PIXELS, N_PIXELS)
    centre, rays = middle(like(picture, LEARNER)), exactly(picture, RAY_FAR, tolerance=12)
    rows, columns = np.nonzero(rays)
    distances = np.hypot(columns - centre[0], rows - centre[1]) / SCALE  # [m]
    near = distances < 0.2  # edges of the walls have every colour between two
    rows, columns, distances = rows[near], columns[near], distances[near]
    assert distances.max() == pytest.approx(RADIUS + REACH, abs=0.004)
    assert distances.min() < RADIUS + 0.006
    assert not (rows > centre[1] + 0.03 * SCALE).any()  # 15° back of the side at most
    assert abs(columns.mean() - centre[0]) < 3  # as many at both sides


@pytest.mark.parametrize("camera", ["top", "chase"])
@pytest.mark.parametrize(("heading", "side"), [(math.pi / 2, 1), (-math.pi / 2, -1)])
def test_rays_end_at_the_wall_and_are_coloured_by_the_reading(draw, camera, heading, side):
    gap = 0.02  # [m] to the wall at x = 0.6
    physics = physics_at("paper", (0.6 - RADIUS - gap, 0.1, heading))
    picture = draw(physics, camera, N_PIXELS, N_PIXELS)
    reading = physics.infrared(0).max()
    colour = (1 - reading) * np.array(RAY_FAR) + reading * np.array(RAY_NEAR)
    near, far = exactly(picture, colour, 14), exactly(picture, RAY_FAR, 14)
    assert near.sum() > 20
    assert far.sum() > 20
    centre = middle(like(picture, LEARNER, 0.06))
    # From above the wall is to the east; the chase camera sees it at the robot's side.
    to_the_wall = 1 if camera == "top" else side
    assert to_the_wall * (middle(near)[0] - centre[0]) > 0
    assert to_the_wall * (middle(far)[0] - centre[0]) < 0
    if camera == "top":
        columns = np.nonzero(near)[1]
        assert columns.max() - centre[0] <= (RADIUS + gap) * SCALE + 3


def test_from_behind_the_learner_is_in_the_middle_and_the_teacher_ahead(draw):
    physics = physics_at(
        "paper", (0.0, 0.2, 0.4), (0.13 * math.cos(0.4), 0.2 + 0.13 * math.sin(0.4), 0.4)
    )
    picture = draw(physics, "chase", 360, 640)
    learner, teacher = (middle(like(picture, colour)) for colour in (LEARNER, TEACHER))
    assert learner[0] == pytest.approx(319.5, abs=2)
    assert teacher[0] == pytest.approx(319.5, abs=2)
    assert teacher[1] < learner[1] - 40
    first_row, last_row, first_column, last_column = extent(like(picture, LEARNER))
    assert first_row > 0
    assert last_row < 359
    assert last_column - first_column > 40


@pytest.mark.parametrize("camera", ["top", "chase"])
@pytest.mark.parametrize("which", ["paper", 3])
def test_both_ways_to_draw_agree(which, camera):
    if os.environ.get("MUJOCO_GL") == "disable":
        pytest.skip("no OpenGL here")
    physics = physics_at(which, (0.3, 0.1, 0.4), (0.42, 0.15, 0.4))
    drawn, rendered = (
        f(physics, camera, 360, 640).astype(float) for f in (draw_arena, render_arena)
    )
    off = np.abs(drawn - rendered).max(axis=2)
    assert (off > 60).mean() < 0.02
    for colour in (WALL, LEARNER, TEACHER):
        one, other = like(drawn, colour), like(rendered, colour)
        assert (one & other).sum() / (one | other).sum() > 0.8


def test_without_gl_pillow_draws():
    environ = {**os.environ, "MUJOCO_GL": "disable"}
    command = [sys.executable, "-c", DRAW_IN_A_NEW_PROCESS]
    done = subprocess.run(command, env=environ, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "drawn by Pillow"


@pytest.fixture
def env():
    made = gymnasium.make(ENV_ID, render_mode="rgb_array", width=160, height=90).unwrapped
    made.reset(seed=0)
    yield made
    made.close()


def test_opengl_draws_where_it_can_be_had(env):
    picture = env.render()
    assert env.draws_with_gl == (os.environ.get("MUJOCO_GL") != "disable")
    way = render_arena if env.draws_with_gl else draw_arena
    assert np.array_equal(picture, way(env._physics, "top", 90, 160))


def test_when_the_context_fails_pillow_takes_over(env, monkeypatch):
    def fail(*_args, **_kwargs):
        raise RuntimeError("no context")

    monkeypatch.setattr(env._physics, "render", fail)
    assert np.array_equal(env.render(), draw_arena(env._physics, "top", 90, 160))
    assert not env.draws_with_gl


def test_the_wanted_camera_draws():
    pictures = []
    for camera in ("top", "chase"):
        env = gymnasium.make(ENV_ID, render_mode="rgb_array", camera=camera).unwrapped
        env.reset(seed=0)
        pictures.append(env.render())
        env.close()
    top, chase = (like(picture, LEARNER).sum() for picture in pictures)
    assert chase > 5 * top > 0


def test_without_a_render_mode_nothing_is_drawn():
    env = gymnasium.make(ENV_ID).unwrapped
    env.reset(seed=0)
    assert env.render() is None
    env.close()
