"""Where points are and how they are turned, from the dimensions of percepts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacnet.schemas.points import Point, Points
from pacnet.schemas.scene import (
    WORLD,
    Scene,
    from_vector,
    landmark_of,
    pose_dimensions,
    poses_of,
    scene_of,
)

HALF = np.sqrt(0.5)
QUARTER = (HALF, 0.0, 0.0, HALF)  # of a turn about z
NO_TURN = (1.0, 0.0, 0.0, 0.0)


def test_places_come_from_their_dimensions():
    points = Points(Point("hand", (4, 0, 2)), (Point("cup", (1, 5, 3)),))
    scene = scene_of(np.arange(12, dtype=np.float32).reshape(2, 6), points)
    assert scene.places.dtype == np.float64
    assert scene.places.tolist() == [[[4, 0, 2], [1, 5, 3]], [[10, 6, 8], [7, 11, 9]]]
    assert scene.turns.tolist() == [[[*NO_TURN]] * 2] * 2


def test_a_plane_has_a_third_coordinate_of_zero_and_turns_about_it():
    points = Points(Point("hand", (0, 1)), (Point("box", (2, 3), (4,)),))
    scene = scene_of(np.array([[1.0, 2, 3, 4, np.pi / 2]]), points)
    assert scene.places.tolist() == [[[1, 2, 0], [3, 4, 0]]]
    np.testing.assert_allclose(scene.turns[0], [NO_TURN, QUARTER])


@pytest.mark.parametrize(
    ("given", "turn"),
    [
        ((), NO_TURN),
        ((np.pi / 2,), QUARTER),  # in three dimensions about the last axis
        ((0.0, 0.0, np.pi / 2), QUARTER),
        ((np.pi, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)),
        (QUARTER, QUARTER),
        ((2.0, 0.0, 0.0, 2.0), QUARTER),  # of another length
        ((0.0, 0.0, 0.0, 0.0), NO_TURN),  # not perceived
    ],
)
def test_all_orientations_become_quaternions(given: tuple[float, ...], turn: tuple[float, ...]):
    cup = Point("cup", (3, 4, 5), tuple(range(6, 6 + len(given))))
    percept = np.array([[0.0] * 6 + [*given]])
    scene = scene_of(percept, Points(Point("hand", (0, 1, 2)), (cup,)))
    np.testing.assert_allclose(scene.turns[0, 1], turn, atol=1e-15)


def test_the_world_is_a_landmark_at_the_origin():
    rng = np.random.default_rng(0)
    scene = Scene(rng.standard_normal((4, 3, 3)), from_vector(rng.standard_normal((4, 3, 3))))
    origin, axes = landmark_of(scene, np.array([0, 1, WORLD, 0]))
    expected = [scene.places[0, 1], scene.places[1, 2], np.zeros(3), scene.places[3, 1]]
    assert origin.tolist() == np.array(expected).tolist()
    expected = [scene.turns[0, 1], scene.turns[1, 2], np.array(NO_TURN), scene.turns[3, 1]]
    assert axes.tolist() == np.array(expected).tolist()


@pytest.mark.parametrize(
    ("place", "orientation", "dimensions"),
    [
        ((0, 1), (), (0, 1)),
        ((0, 1), (2,), (0, 1, 5)),
        ((0, 1, 2), (), (0, 1, 2)),
        ((0, 1, 2), (3,), (0, 1, 2, 5)),
        ((0, 1, 2), (3, 4, 5), (0, 1, 2, 3, 4, 5)),
        ((0, 1, 2), (3, 4, 5, 6), (0, 1, 2, 3, 4, 5)),
    ],
)
def test_poses_have_the_dimensions_of_the_point(place, orientation, dimensions):
    hand = Point("hand", place, orientation)
    assert pose_dimensions(hand) == dimensions
    cup = Point("cup", tuple(7 + i for i in range(len(place))))
    percepts = np.random.default_rng(0).standard_normal((5, 10))
    poses = poses_of(scene_of(percepts, Points(hand, (cup,))), hand)
    assert poses.shape == (5, len(dimensions))
    np.testing.assert_allclose(poses[:, : len(place)], percepts[:, place])


def test_poses_never_jump_where_angles_do():
    """Two turns in the plane, of which the angle is known to one."""
    angles = np.linspace(0.5, 0.5 + 4 * np.pi, 100)
    percepts = np.zeros((100, 5))
    percepts[:, 4] = (angles + np.pi) % (2 * np.pi) - np.pi
    hand = Point("hand", (0, 1), (4,))
    poses = poses_of(scene_of(percepts, Points(hand, (Point("box", (2, 3)),))), hand)
    np.testing.assert_allclose(poses[:, 2], angles, atol=1e-9)


def test_poses_do_not_depend_on_the_sign_of_quaternions():
    vectors = np.linspace(0, 1, 20)[:, None] * (0.3, -1.0, 2.0)
    turns = from_vector(vectors)
    turns[::2] *= -1
    hand = Point("hand", (0, 1, 2), (3, 4, 5, 6))
    poses = poses_of(Scene(np.zeros((20, 2, 3)), np.stack([turns, turns], axis=1)), hand)
    np.testing.assert_allclose(poses[:, 3:], vectors, atol=1e-12)


def test_poses_add_up_turns_about_the_axes_of_the_world():
    rotations = Rotation.from_rotvec(np.random.default_rng(0).uniform(-0.4, 0.4, (20, 3)))
    turns = np.roll(rotations.as_quat(), 1, axis=1)
    hand = Point("hand", (0, 1, 2), (3, 4, 5, 6))
    poses = poses_of(Scene(np.zeros((20, 2, 3)), np.stack([turns, turns], axis=1)), hand)
    changes = (rotations[1:] * rotations[:-1].inv()).as_rotvec()
    np.testing.assert_allclose(np.diff(poses[:, 3:], axis=0), changes, atol=1e-12)
    np.testing.assert_allclose(poses[0, 3:], rotations[0].as_rotvec(), atol=1e-12)
