"""A layout: where points are from one another, how they are turned, and a little of the rest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacnet.schemas.layout_kernels import OTHER, TURN, layouts, length


def test_a_layout_has_all_pairs_of_points_all_turns_and_the_rest():
    places = np.array([[[1.0, 2, 3], [2, 2, 5], [0, 0, 0]]])
    rotations = Rotation.from_rotvec([[0.1, 0.2, 0.3], [1, -1, 0.5], [0, 0, 0]])
    turns = np.roll(rotations.as_quat(), 1, axis=1)[None]
    layout = layouts(places, turns, np.array([[0.4, 0.8]]), 2.0)[0]
    apart = [1, 0, 2, -1, -2, -3, -2, -2, -5]  # of the second and the third from those before
    axes = rotations.as_matrix()[:, :, :2].transpose(0, 2, 1).ravel()  # where x and y go
    expected = np.concatenate([np.array(apart) / 2, TURN * axes, OTHER * np.array([0.4, 0.8])])
    np.testing.assert_allclose(layout, expected, atol=1e-14)


@pytest.mark.parametrize(("points", "others"), [(2, 0), (3, 1), (5, 4)])
def test_layouts_of_many_scenes_have_a_row_each(points: int, others: int):
    rng = np.random.default_rng(points)
    places, rest = rng.standard_normal((4, points, 3)), rng.standard_normal((4, others))
    turns = np.zeros((4, points, 4))
    turns[..., 0] = 1
    rows = layouts(places, turns, rest, 0.5)
    assert rows.shape == (4, length(points, others))
    assert length(points, others) == 3 * points * (points - 1) // 2 + 6 * points + others
    for row in range(4):
        one = layouts(places[row : row + 1], turns[row : row + 1], rest[row : row + 1], 0.5)
        np.testing.assert_array_equal(rows[row], one[0])
