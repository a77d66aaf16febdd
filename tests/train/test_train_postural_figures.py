"""Figures of Experiment 1 draw the arrays that they are given."""

import io

import numpy as np
import pytest

from train.postural.figures import robustness, threshold_sweep, wrist_paths


def cloud(rows: int, columns: int = 2, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, columns))


def written(axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_every_figure_renders():
    for figure in (
        wrist_paths(cloud(20, 3), cloud(30, 3, 1)),
        robustness(["taught", "faster"], [1.0, 0.9], [0.01, 0.02]),
        threshold_sweep([0.2, 0.5], [3, 12], {"by cue": [0.1, 1.0]}, 0.5),
    ):
        png = io.BytesIO()
        figure.savefig(png, format="png", dpi=40)
        assert png.getvalue().startswith(b"\x89PNG")


def test_wrist_paths_show_width_depth_and_height_in_true_proportion():
    one, other = cloud(20, 3), cloud(30, 3, 1)
    figure = wrist_paths(one, other)
    for axes, column in zip(figure.axes, (0, 2), strict=True):
        bold, thin = axes.lines[:2]
        np.testing.assert_array_equal(bold.get_xydata(), one[:, [1, column]])
        np.testing.assert_array_equal(thin.get_xydata(), other[:, [1, column]])
        assert bold.get_linewidth() > 2 * thin.get_linewidth()
        assert axes.get_aspect() == 1
        left, right = axes.get_xlim()
        assert left > right
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["demonstrator", "imitator"]


def test_robustness_has_a_bar_and_a_number_for_each_condition():
    names = ["taught", "25 % faster", "four times the noise"]
    left, right = robustness(names, [1.0, 0.97, 0.5], [0.012, 0.02, 0.05]).axes
    assert [label.get_text() for label in left.get_yticklabels()] == names
    assert [bar.get_width() for bar in left.patches] == [1.0, 0.97, 0.5]
    assert [bar.get_width() for bar in right.patches] == pytest.approx([1.2, 2.0, 5.0])  # [cm]
    assert written(left) == ["100%", "97%", "50%"]
    assert written(right) == ["1.2", "2.0", "5.0"]
    bottom, top = left.get_ylim()
    assert bottom > top  # the first condition is on top


def test_threshold_sweep_has_two_axes_and_marks_the_shipped_one():
    thresholds, nodes = [0.2, 0.5, 0.8], [3, 12, 60]
    rates = {"by cue": [0.1, 1.0, 0.9], "in order": [0.2, 0.6, 0.0]}
    figure = threshold_sweep(thresholds, nodes, rates, 0.5)
    left, right = figure.axes
    np.testing.assert_array_equal(left.lines[0].get_xydata(), np.c_[thresholds, nodes])
    for line, rate in zip(right.lines, rates.values(), strict=True):
        np.testing.assert_array_equal(line.get_xydata(), np.c_[thresholds, rate])
    assert set(left.lines[1].get_xdata()) == {0.5}
    assert (left.get_ylabel(), right.get_ylabel()) == ("nodes", "success rate")
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["nodes", "shipped threshold 0.5", "success, by cue", "success, in order"]


@pytest.mark.parametrize(
    ("draw", "arguments", "message"),
    [
        (wrist_paths, (cloud(5, 3), cloud(5, 2)), r"imitator as numbers \[S, 3\]"),
        (robustness, ("ab", [1.0], [0.1, 0.2]), r"success_rates as numbers \[2\]"),
        (robustness, ("ab", [1.0, 0.9], [0.1, np.inf]), "finite wrist_distances"),
        (threshold_sweep, ([0.2, 0.5], [3], {}, 0.5), r"nodes as numbers \[2\]"),
        (threshold_sweep, ([0.2, 0.5], [0, 3], {}, 0.5), "nodes ≥ 1"),
        (threshold_sweep, ([0.2], [3], {"by cue": []}, 0.5), r"by cue as numbers \[1\]"),
    ],
)
def test_bad_input_is_refused(draw, arguments, message):
    with pytest.raises(ValueError, match=message):
        draw(*arguments)
