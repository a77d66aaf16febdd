"""A percept implies where the hand is, and where things stood before the hand took them."""

from __future__ import annotations

import numpy as np
import pytest
from arms import JOINTS, body, pose
from scipy.spatial.transform import Rotation

from pacnet.attention.cutting import Size
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.schemas.body import BodyConfig
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.percept_extension import PerceptExtension
from pacnet.schemas.points import Point, Points

EXTENT = 1.0  # of the scene: near is 0.3, and put elsewhere is more than 0.05
HAND, CUP, PLATE = (0, 1, 2), (3, 4, 5), (6, 7, 8)
SEEN = FramesConfig(
    Points(
        Point("hand", HAND),
        (
            Point("cup", CUP),
            Point("plate", PLATE),
            Point("p", (9, 10, 11)),
            Point("c", (12, 13, 14)),
        ),
    ),
    Size(EXTENT, 0.01),
    ((1.0, 1.0),) * 5,
    (),
    (),
    AffineForwardModelConfig(3, 3, 1, (-1,) * 3),
    put_back=(1, 0),
)


def rows(hand: list[float], cup: list[float], plate: float = 5.0) -> np.ndarray:
    """Percepts `[T, 9]` in which the hand and the cup move along the first axis."""
    percepts = np.zeros((len(hand), 9), np.float32)
    percepts[:, HAND[0]], percepts[:, CUP[0]], percepts[:, PLATE[1]] = hand, cup, plate
    return percepts


def stood(percepts: np.ndarray) -> list[float]:
    """Where the cup stood along the first axis, row by row."""
    extended = PerceptExtension(SEEN, None).episode(percepts)
    assert extended.shape == (len(percepts), 15)
    np.testing.assert_array_equal(extended[:, :9], percepts)
    return extended[:, 12].tolist()


def test_where_it_stood_is_the_mean_while_the_hand_is_away():
    """0.52, (0.52 + 0.50) / 2, (0.52 + 0.50 + 0.48) / 3."""
    assert stood(rows([0.0] * 3, [0.52, 0.50, 0.48])) == pytest.approx([0.52, 0.51, 0.50])


def test_nothing_is_taken_in_while_the_hand_is_near():
    """Nearer than 0.3; then it is carried to another place, and left there."""
    hand = [0.0, 0.1, 0.21, 0.4, 0.6, 0.9, 1.2, 0.5, 0.4]
    cup = [0.5, 0.52, 0.49, 0.49, 0.6, 0.9, 1.2, 1.2, 1.2]
    expected = [0.5, 0.51, 0.51, 0.51, 0.51, 0.51, 0.51, 1.2, 1.2]
    assert stood(rows(hand, cup)) == pytest.approx(expected)


def test_what_was_put_elsewhere_begins_a_mean_anew():
    """More than 0.05 away; the mean is then of what is seen there."""
    cup = [0.50, 0.54, 0.60, 0.62, 0.50]
    assert stood(rows([0.0] * 5, cup)) == pytest.approx([0.50, 0.52, 0.60, 0.61, 0.50])


def test_what_the_hand_is_near_at_first_stands_where_it_is():
    assert stood(rows([0.5, 0.6, 0.7], [0.5, 0.6, 0.7])) == pytest.approx([0.5, 0.5, 0.5])


def test_the_units_of_places_change_nothing():
    size = Size(1000 * EXTENT, 10.0)
    from_metres = stood(rows([0.0, 0.1, 0.3, 0.9], [0.5, 0.52, 0.47, 0.9]))
    in_millimetres = FramesConfig(
        SEEN.points, size, SEEN.smoothing, (), (), SEEN.forward_model, put_back=SEEN.put_back
    )
    percepts = 1000 * rows([0.0, 0.1, 0.3, 0.9], [0.5, 0.52, 0.47, 0.9])
    extended = PerceptExtension(in_millimetres, None).episode(percepts)
    np.testing.assert_allclose(extended[:, 12], 1000 * np.array(from_metres), rtol=1e-6)


def test_several_objects_are_remembered_apart_in_the_order_of_the_settings():
    """The plate comes first; the hand is near the cup for a frame."""
    percepts = rows([0.0, 0.45, 0.3], [0.5, 0.6, 0.7])
    percepts[:, PLATE[1]] = [5.0, 5.02, 5.04]
    extended = PerceptExtension(SEEN, None).episode(percepts)
    np.testing.assert_allclose(extended[:, 9:12], [[0, 5.0, 0], [0, 5.01, 0], [0, 5.02, 0]])
    np.testing.assert_allclose(extended[:, 12:], [[0.5, 0, 0], [0.5, 0, 0], [0.7, 0, 0]], rtol=1e-6)


def random_walk(seed: int, width: int) -> np.ndarray:
    steps = np.random.default_rng(seed).normal(0, 0.08, (200, width))
    return steps.cumsum(axis=0).astype(np.float32)


def test_an_episode_is_what_its_percepts_are_one_by_one():
    extension, percepts = PerceptExtension(SEEN, None), random_walk(0, 9)
    whole = extension.episode(percepts)
    extension.reset()
    np.testing.assert_array_equal(np.stack([extension(one) for one in percepts]), whole)
    np.testing.assert_array_equal(extension.episode(percepts), whole)  # it begins anew
    assert extension(percepts[0]).tolist() != whole[0].tolist()  # it goes on
    extension.reset()
    np.testing.assert_array_equal(extension(percepts[0]), whole[0])


def test_percepts_are_not_changed():
    percepts = random_walk(1, 9)
    before = percepts.copy()
    extension = PerceptExtension(SEEN, None)
    extension.episode(percepts)
    extension(percepts[3])
    np.testing.assert_array_equal(percepts, before)


ANGLES = (6, 4, 3, 5)  # dimensions of a percept of seven; the cup is the first three


def with_body(put_back: bool) -> FramesConfig:
    """The hand is appended to a percept of seven numbers, then where the cup stood."""
    former = (Point("cup's place", (14, 15, 16)),) if put_back else ()
    model = body().config
    return FramesConfig(
        Points(Point("hand", (7, 8, 9), (10, 11, 12, 13)), (Point("cup", (0, 1, 2)), *former)),
        Size(EXTENT, 0.01),
        ((1.0, 1.0),) * (2 + put_back),
        (),
        (),
        None,
        BodyConfig(model, ANGLES, tuple(range(len(JOINTS)))),
        (0,) if put_back else (),
    )


@pytest.mark.parametrize("put_back", [False, True])
def test_where_the_hand_is_follows_from_the_angles(put_back: bool):
    """By the arm's own trigonometry; place, then a quaternion."""
    config, random = with_body(put_back), np.random.default_rng(2)
    percepts = random.uniform(-2, 2, (20, 7)).astype(np.float32)
    extension = PerceptExtension(config, body().arrays())
    extended = extension.episode(percepts)
    assert extended.shape == (20, 7 + len(config.added))
    for one, row in zip(percepts, extended, strict=True):
        place, turn = pose(one[list(ANGLES)].astype(np.float64))
        np.testing.assert_allclose(row[7:10], place, atol=1e-9)
        seen = Rotation.from_quat(np.roll(row[10:14], -1)).as_matrix()
        np.testing.assert_allclose(seen, turn, atol=1e-9)
    extension.reset()
    np.testing.assert_array_equal(np.stack([extension(one) for one in percepts]), extended)


def test_with_a_body_the_hand_that_is_near_is_the_one_it_tells_of():
    config = with_body(put_back=True)
    percepts = np.zeros((3, 7), np.float32)
    percepts[:, 0] = [2.0, 0.75, 0.8]  # the arm is stretched out: its hand is at (0.7, 0, 0.3)
    percepts[:, 2] = 0.3
    extended = PerceptExtension(config, body().arrays()).episode(percepts)
    np.testing.assert_allclose(extended[:, 14], [2.0, 2.0, 2.0])
