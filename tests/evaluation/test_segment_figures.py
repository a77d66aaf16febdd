"""The figure of where an episode is cut."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Rectangle

from pacnet.evaluation.segment_figures import distances_over_time
from pacnet.imitator.cuts import Approach

NAMES = ("hand", "cup", "shelf")
# Four frames to the cup, two nowhere, four to the shelf with the cup.
APPROACH = Approach(
    np.stack([[4, 3, 2, 1, 1, 1, 1, 1, 1, 1], [5, 5, 5, 5, 5, 4, 3, 2, 1, 0]], axis=1) * 0.1,
    np.array([0, 0, 0, 0, -1, -1, 1, 1, 1, 1]),
    np.stack([np.arange(10) > 5, np.zeros(10, bool)], axis=1),
)


def axes_of(approach: Approach = APPROACH):
    (axes,) = distances_over_time(approach, NAMES, 0.5, "Episode 1").axes
    return axes


def test_stretches_have_the_colour_and_the_name_of_their_landmark():
    axes = axes_of()
    spans = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    edges = [(span.get_x(), span.get_x() + span.get_width()) for span in spans]
    assert edges == [(0, 2), (2, 3), (3, 5)]
    assert [text.get_text() for text in axes.texts] == ["cup", "no landmark", "shelf"]
    assert [text.get_position()[0] for text in axes.texts] == [1, 2.5, 4]
    thick = [line for line in axes.lines if line.get_linewidth() == 2]
    colours = [to_hex(to_rgb(span.get_facecolor())) for span in spans]
    assert colours[0] == to_hex(thick[0].get_color())
    assert colours[2] == to_hex(thick[1].get_color())
    assert len(set(colours)) == 3


def test_a_line_is_thin_while_its_landmark_is_carried():
    lines = axes_of().lines
    thick = [line.get_ydata() for line in lines if line.get_linewidth() == 2]
    np.testing.assert_array_equal(np.isnan(thick[0]), np.arange(10) > 5)
    np.testing.assert_allclose(thick[1], APPROACH.distances[:, 1])
    np.testing.assert_allclose(lines[0].get_ydata(), APPROACH.distances[:, 0])  # whole, thin
    np.testing.assert_allclose(lines[0].get_xdata(), 0.5 * np.arange(10))


def test_a_name_without_room_is_left_out():
    short = APPROACH._replace(landmark=np.array([0] * 9 + [1]))
    (axes,) = distances_over_time(short, ("hand", "cup", "a shelf far away"), 0.5, "Episode").axes
    assert [text.get_text() for text in axes.texts] == ["cup"]


def test_the_legend_says_what_lines_are():
    def labels(approach: Approach) -> list[str]:
        (legend,) = distances_over_time(approach, NAMES, 0.5, "Episode").legends
        return [text.get_text() for text in legend.get_texts()]

    assert labels(APPROACH) == ["cup", "shelf", "thin: the landmark is carried"]
    assert labels(APPROACH._replace(carried=np.zeros((10, 2), bool))) == ["cup", "shelf"]


def test_any_episode_can_be_drawn(tmp_path: Path):
    rng = np.random.default_rng(0)
    for frames, count in ((1, 1), (50, 8)):
        approach = Approach(
            rng.uniform(0, 1, (frames, count)),
            rng.integers(-1, count, frames),
            rng.uniform(0, 1, (frames, count)) > 0.5,
        )
        names = ["hand", *(f"landmark {number}" for number in range(count))]
        figure = distances_over_time(approach, names, 0.02, "An episode of $ " * 20)
        figure.savefig(tmp_path / "figure.png")
    still = Approach(np.zeros((3, 1)), np.zeros(3, np.int64), np.zeros((3, 1), bool))
    distances_over_time(still, ("hand", "cup"), 0.1, "").savefig(tmp_path / "figure.png")


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="expected names of 3 points, got"):
        distances_over_time(APPROACH, NAMES[1:], 0.5, "Episode")
    with pytest.raises(ValueError, match="expected timestep > 0"):
        distances_over_time(APPROACH, NAMES, 0.0, "Episode")
