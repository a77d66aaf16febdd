"""The camera beside each body's head: what it sees, and that both bodies see alike."""

import math

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import envs  # noqa: F401  registers the environment
from envs.glass_offset import DIRECTIONS
from envs.head_camera import SIZE, camera_of
from envs.pinhole import NEAREST, Pinhole
from envs.scene import FOAM, IMITATOR, WHO

ENV_ID = "pacnet/PosturalImitation-v0"
FOAM_HEIGHT = 0.037  # [m] of its middle above the glass's
TO_THE_WORLD = np.array([(-1, -1, 1)] * 3), np.array((0.62, 0, 1.0))  # of the imitator's frame

# Directions in which glasses are drawn, at the largest distance, and the usual place.
PLACES = [(0.1 * math.cos(a), 0.1 * math.sin(a)) for a in np.linspace(*DIRECTIONS, 8)]
PLACES += [(0.0, 0.0)]


def foam_in(picture):
    """Return rows and columns `[N, 2]` of pixels with the colour of foam."""
    colour = np.array(FOAM[:3]) * 255
    return np.argwhere(np.abs(picture.astype(float) - colour).max(axis=2) < 4)


def looks(env, offset=(0.0, 0.0), **options):
    env.reset(seed=3, options={"glass_offset": offset, **options})
    return {who: env.look(who) for who in WHO}


def test_the_same_state_gives_the_same_bytes(noisy):
    pictures = looks(noisy)
    made = gymnasium.make(ENV_ID, render_mode="rgb_array").unwrapped
    again = looks(made)
    made.close()
    for who in WHO:
        assert pictures[who].shape == (SIZE, SIZE, 3)
        assert pictures[who].dtype == np.uint8
        np.testing.assert_array_equal(pictures[who], again[who])


def test_looking_changes_nothing(noisy):
    def play(look):
        noisy.reset(seed=5)
        for _ in range(5):
            if look:
                noisy.look()
            observation = noisy.step_to(noisy.rest_posture)[0]
        return np.concatenate([*observation.values()])

    np.testing.assert_array_equal(play(look=False), play(look=True))


@pytest.mark.parametrize("offset", PLACES)
def test_the_foam_is_where_a_pinhole_has_it_and_there_is_no_other(noisy, offset):
    _, info = noisy.reset(seed=4, options={"glass_offset": offset, "demonstrator": "absent"})
    found = foam_in(noisy.look())
    middle = info["glass_position"] + (0, 0, FOAM_HEIGHT)
    turn, origin = TO_THE_WORLD
    camera = Pinhole(noisy._physics, camera_of(IMITATOR), SIZE, SIZE)
    column, row = camera.project((middle * turn[0] + origin)[None])[0]
    np.testing.assert_allclose(found.mean(axis=0) + 0.5, (row, column), atol=1.5)
    assert np.abs(found - (row, column)).max() < 16  # a foam is some 24 pixels wide
    assert found.min() > 0  # all of it is in the picture
    assert found.max() < SIZE - 1


@pytest.mark.parametrize("offset", PLACES)
def test_both_heads_see_alike(noisy, offset):
    """Also where nobody is opposite, as where the imitator acts alone."""
    seen = looks(noisy, offset)
    alone = looks(noisy, offset, demonstrator="absent")[IMITATOR]
    differs = [(picture != alone).any(axis=2).mean() for picture in seen.values()]
    assert max(differs) < 0.002


def test_a_glass_that_is_absent_or_far_is_not_in_the_picture(noisy):
    for own_glass in ("absent", "far"):
        picture = looks(noisy, own_glass=own_glass)[IMITATOR]
        assert len(foam_in(picture)) == 0


def test_the_own_arm_comes_into_the_picture(noiseless):
    noiseless.reset(seed=3)
    before = noiseless.look()
    for _ in range(115):  # 2.3 s: the hand is at the glass
        noiseless.step_to(noiseless.demonstrator_target)
    assert (before != noiseless.look()).any(axis=2).mean() > 0.05


def test_bad_calls_are_refused(noisy):
    with pytest.raises(ValueError, match=r"who must be one of .*, got 'table'"):
        noisy.look("table")
    fresh = gymnasium.make(ENV_ID).unwrapped
    with pytest.raises(ResetNeeded):
        fresh.look()
    fresh.close()


def test_a_ball_with_a_point_in_the_picture_is_never_left_out(noisy):
    noisy.reset(seed=0)
    camera = Pinhole(noisy._physics, camera_of(IMITATOR), 90, 128)
    rng = np.random.default_rng(0)
    centres = camera.position + rng.normal(0, 0.5, (400, 3))
    radii = rng.uniform(0.01, 0.3, 400)
    turns = rng.normal(size=(200, 3))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    points = centres[:, None] + radii[:, None, None] * turns
    pixels = camera.project(points.reshape(-1, 3)).reshape(400, 200, 2)
    in_front = camera.depth(points.reshape(-1, 3)).reshape(400, 200) > NEAREST
    inside = ((pixels > 0) & (pixels < (128, 90))).all(axis=2) & in_front
    seen = camera.sees(centres, radii)
    assert seen[inside.any(axis=1)].all()
    assert 0.02 < seen.mean() < 0.5  # most are out of it
