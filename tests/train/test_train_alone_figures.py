"""Figures of those who act alone draw what they are given."""

import numpy as np
import pytest

from envs.scene import GLASS_PLACE
from train.postural.alone.figures import mirror_winners, places_tried


def test_winners_of_both_are_counted_from_their_grasps_and_share_rows():
    winners = {"watching": np.array([4, 4, 2, 2, 7]), "alone": np.array([4, 2, 2, 7, 7])}
    figure = mirror_winners(winners, {"watching": (2, 4), "alone": (1, 3)}, 2, 0.5)
    watching, alone = figure.axes
    assert [label.get_text() for label in watching.get_yticklabels()] == ["4", "2", "7"]
    rows = {"watching": [0, 0, 1, 1, 2], "alone": [0, 1, 1, 2, 2]}  # 4, 2, 7 by first win
    starts = {"watching": -1.0, "alone": -0.5}  # [s] before the grasp
    for axes, title in ((watching, "watching"), (alone, "alone")):
        seconds = starts[title] + 0.5 * np.arange(5)
        np.testing.assert_allclose(axes.lines[0].get_xydata(), np.c_[seconds, rows[title]])
        grasp, row = axes.patches
        assert (grasp.get_x(), grasp.get_width()) == (0, 1.0)
        assert (row.get_y(), row.get_height()) == (0.5, 1.0)  # of node 2


def test_places_are_drawn_by_success_as_the_body_sees_them():
    offsets = np.array([[0.0, 0.1], [-0.1, 0.0], [0.05, -0.05]])
    success = np.array([True, False, True])
    figure = places_tried({"ours": (offsets, success), "replay": (offsets, ~success)})
    ours, replay = figure.axes
    assert ours.get_title(loc="left") == "ours: 2 of 3"
    assert replay.get_title(loc="left") == "replay: 1 of 3"
    forwards, left = GLASS_PLACE
    drank, did_not = (dots.get_offsets() for dots in ours.collections)
    np.testing.assert_allclose(drank, [[left + 0.1, forwards], [left - 0.05, forwards + 0.05]])
    np.testing.assert_allclose(did_not, [[left, forwards - 0.1]])
    right_edge, left_edge = ours.get_xlim()
    assert right_edge > left_edge  # the left on the left


def test_the_reach_that_is_drawn_holds_the_places_that_are_drawn_from():
    from train.postural.alone.scenes import RADIUS, draw_place

    offsets = np.array([draw_place(seed, RADIUS) for seed in range(200)])
    axes = places_tried({"ours": (offsets, np.ones(200, bool))}).axes[0]
    reach = axes.patches[0].get_path()
    points = axes.collections[0].get_offsets()
    assert reach.contains_points(points, radius=1e-3).all()
    back = 2 * np.array(GLASS_PLACE)[::-1] - points  # the other way from the usual place
    assert not reach.contains_points(back).all()


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match="winners"):
        mirror_winners({"alone": np.ones(3)}, {"alone": (0, 1)}, 1, 0.02)
    with pytest.raises(ValueError, match=r"success as numbers \[2\]"):
        places_tried({"ours": (np.zeros((2, 2)), np.ones(3))})
    with pytest.raises(ValueError, match=r"offsets as numbers \[N, 2\]"):
        places_tried({"ours": (np.zeros((2, 3)), np.ones(2))})
