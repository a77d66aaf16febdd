"""The imitator's own glass: its percept, and glasses that cannot be drunk."""

import itertools

import gymnasium
import numpy as np
import pytest
from playing import copy, play

import envs  # noqa: F401  registers the environment
from envs.behaviours import REST_POSTURE
from envs.drawing import draw_scene
from envs.kinematics import RIGHT_ARM, BodyKinematics
from envs.own_glass import FAR_X, FAR_Y, OWN_GLASSES, own_glass_pose
from envs.physics import Physics
from envs.scene import GLASS_REST_Z, GRIP_HEIGHT, GRIP_STRETCH, TABLE_HALF_SIZE

ENV_ID = "pacnet/PosturalImitation-v0"
UNFIT = [glass for glass in OWN_GLASSES if glass != "standing"]


def test_own_and_other_glass_are_perceived_alike(noiseless):
    """The scene is symmetric, and both do the same with their glasses."""
    observations, infos = play(noiseless, copy)
    own = np.array([observation["own_glass"] for observation in observations])
    other = np.array([observation["glass"] for observation in observations])
    assert np.abs(own - other)[25:, :3].max() < 0.02
    assert np.abs(own - other)[25:, 3:].max() < 0.1
    assert own[:, 4].min() < -0.6  # a turn about the leftwards axis brings the rim to the face
    positions = np.array([info["glass_position"] for info in infos])
    assert np.abs(own[:, :3] - positions).max() < 1e-6


def test_noise_of_the_own_glass(noisy, noiseless):
    """5 mm and 0.01 rad, independent of that of the other's."""
    seen, _ = play(noisy)
    truth, _ = play(noiseless)
    errors = {
        key: np.array([a[key] - b[key] for a, b in zip(seen, truth, strict=True)])
        for key in ("own_glass", "glass")
    }
    for part, std in ((slice(0, 3), 0.005), (slice(3, 6), 0.01)):
        error = errors["own_glass"][:, part]
        assert error.std() == pytest.approx(std, rel=0.1)
        assert abs(error.mean()) < 0.1 * std
    correlation = np.corrcoef(errors["own_glass"].ravel(), errors["glass"].ravel())[0, 1]
    assert abs(correlation) < 0.1


def test_a_tipped_glass_lies_at_its_place_and_stays(noiseless):
    directions = []
    for seed in range(12):
        observations, infos = play(noiseless, n_steps=60, seed=seed, own_glass="tipped")
        first, last = observations[0]["own_glass"], observations[-1]["own_glass"]
        assert np.abs(last - first).max() < 0.005
        assert np.linalg.norm(last[3:]) == pytest.approx(np.pi / 2, abs=1e-3)
        assert np.abs(last[:2] - observations[0]["glass"][:2]).max() < 0.002
        assert 0.03 < GLASS_REST_Z - last[2] < 0.05  # half its height less half its side: 3.9 cm
        assert infos[-1]["glass_tilt"] == pytest.approx(np.pi / 2, abs=1e-3)
        directions.append(np.arctan2(last[4], last[3]))
    assert np.ptp(directions) > 3.0


@pytest.mark.parametrize("direction", [-2.0, 0.0, 0.7])
def test_a_tipped_glass_points_in_its_direction(direction):
    class Fixed:
        def uniform(self, *_):
            return direction

    pose = own_glass_pose("tipped", np.array((0.5, -0.07)), Fixed())
    physics = Physics.build()
    physics.begin(np.stack([REST_POSTURE] * 2), np.array((0.5, -0.07)), pose)
    axis = physics.scene_state.axis[1]
    assert axis == pytest.approx((np.cos(direction), np.sin(direction), 0.0), abs=1e-9)
    assert physics.scene_state.glass[1] == pytest.approx(pose[:3])
    assert physics.scene_state.axis[0] == pytest.approx((0.0, 0.0, 1.0))


def grip_misses(body, place):
    """The least distance [m] found from a grip to where a hand can take a glass standing there."""

    def error(pose):
        offset = pose.grip - (*place, GLASS_REST_Z + GRIP_HEIGHT)
        offset[2] -= np.clip(offset[2], -GRIP_STRETCH, GRIP_STRETCH)
        return offset

    rng = np.random.default_rng(0)
    misses = []
    for _ in range(6):
        start = REST_POSTURE.copy()
        start[list(RIGHT_ARM)] = rng.uniform(*body.joint_range[list(RIGHT_ARM)].T)
        misses.append(np.linalg.norm(error(body.pose(body.solve(start, error)))))
    return min(misses)


def test_a_far_glass_is_out_of_reach_and_on_the_table(noiseless):
    body = BodyKinematics()
    for place in itertools.product(FAR_X, FAR_Y):
        assert grip_misses(body, place) > 0.05, place
    assert grip_misses(body, (0.5, -0.07)) < 0.01  # the usual place is within reach
    assert FAR_Y[1] + 0.036 < TABLE_HALF_SIZE[1]
    places = []
    for seed in range(10):
        _, infos = play(noiseless, n_steps=50, seed=seed, own_glass="far")
        places.append(infos[-1]["glass_position"])
        assert places[-1][2] == pytest.approx(GLASS_REST_Z, abs=1e-3)
        assert infos[-1]["glass_tilt"] < 1e-3
    low, high = np.array((FAR_X, FAR_Y)).T
    assert (np.array(places)[:, :2] >= low - 1e-3).all()
    assert (np.array(places)[:, :2] <= high + 1e-3).all()
    assert (np.ptp(places, axis=0)[:2] > 0.02).all()


def test_an_absent_glass_is_perceived_as_zeros_and_cannot_be_taken(noisy):
    observations, infos = play(noisy, copy, own_glass="absent")
    assert not np.any([observation["own_glass"] for observation in observations])
    assert not any(info["glass_held"] for info in infos)
    assert infos[-1]["glass_position"] == pytest.approx(infos[0]["glass_position"], abs=0.01)
    assert infos[0]["glass_position"][0] < -0.5  # behind the imitator


@pytest.mark.parametrize("glass", UNFIT)
def test_only_the_demonstrator_succeeds_without_a_standing_glass(noiseless, glass):
    _, infos = play(noiseless, copy, own_glass=glass)
    assert infos[-1]["demonstrator_success"]
    assert not any(info["is_success"] for info in infos)


@pytest.mark.parametrize("glass", UNFIT)
def test_a_drink_from_another_glass_than_the_standing_one_does_not_count(noiseless, glass):
    _, info = noiseless.reset(seed=3, options={"own_glass": glass})
    angles = np.stack([info["demonstrator_angles"], info["imitator_angles"]])
    noiseless._physics.begin(angles, noiseless._place)  # somebody puts one there
    truncated = False
    while not truncated:
        *_, truncated, info = noiseless.step_to(noiseless.demonstrator_target)
    assert info["mouth_reached"]
    assert info["glass_from_place"] < 0.03
    assert not info["is_success"]


def test_a_picture_shows_no_absent_glass():
    env = gymnasium.make(ENV_ID, render_mode="rgb_array").unwrapped
    pictures = []
    for glass in ("standing", "absent"):
        env.reset(seed=0, options={"own_glass": glass})
        pictures.append((env.render(), draw_scene(env._physics, 360, 640)))
    for with_it, without in zip(*pictures, strict=True):
        rows, columns = np.nonzero(np.any(with_it != without, axis=2))
        assert 0 < np.ptp(rows) < 80  # a glass's height and no more
        assert 0 < np.ptp(columns) < 40
    env.close()
