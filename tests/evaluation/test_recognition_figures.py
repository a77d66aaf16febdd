"""The figure of a recognized episode."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib import cbook
from matplotlib.colors import to_hex
from recognitions import make_recognition

from pacnet.competition.recognition import Recognition
from pacnet.evaluation.recognition_figures import recognition_over_time

BEHAVIOURS = ("drink", "wave")


RIGHT = make_recognition([1, 0, 1, 0, 0], [0.0, 0.25, 0.5, 0.75, 0.9], [0.1] * 5)
WRONG = make_recognition([1, 1, 1], [0.0, 0.3, 1.0], [0.1, 0.6, 0.8])


def panels(recognition: Recognition):
    return recognition_over_time(recognition, BEHAVIOURS, 0.5, 0.1, "Episode 1").axes


def test_shares_of_the_behaviours_fill_the_panel_at_every_sample():
    shares = panels(RIGHT)[0].collections
    assert len(shares) == 2
    inside = [
        [area.get_paths()[0].contains_point((0.05 + 0.1 * k, 0.5)) for k in range(5)]
        for area in shares
    ]
    # At half height there is the behaviour of 80 %: the first below, the second above.
    assert inside == [[False, True, False, True, True], [True, False, True, False, False]]


def test_progress_has_the_colour_of_the_behaviour_named():
    probability, progress = panels(RIGHT)[:2]
    colours = [to_hex(area.get_facecolor()[0]) for area in probability.collections]
    dots = {to_hex(line.get_color()): line.get_xdata() for line in progress.lines[1:]}
    np.testing.assert_allclose(dots[colours[0]], [0.1, 0.3, 0.4])
    np.testing.assert_allclose(dots[colours[1]], [0, 0.2])
    assert colours[0] != colours[1]


def test_novel_stretches_are_shaded_and_unmatched_samples_are_marked():
    _, progress, novelty, winners = panels(WRONG)
    for axes in (progress, novelty, winners):
        (shade,) = axes.collections
        edges = shade.get_paths()[0].vertices[:, 0]
        assert (edges.min(), edges.max()) == pytest.approx((0.1, 0.3))
    assert novelty.lines[1].get_ydata()[0] == 0.5  # the threshold
    marks = winners.lines[-1]
    assert marks.get_marker() == "x"
    np.testing.assert_allclose(marks.get_xdata(), [0.2])
    assert [label.get_text() for label in winners.get_yticklabels()] == ["0", "1", "no match"]


def test_any_episode_can_be_drawn(tmp_path: Path):
    rng = np.random.default_rng(0)
    for samples, behaviours, nodes in ((1, 1, 1), (40, 9, 30)):
        shares = torch.from_numpy(rng.dirichlet(np.ones(behaviours), samples))
        zeros = torch.zeros(samples)
        recognition = Recognition(
            shares, shares.argmax(1), zeros, zeros, zeros, zeros, zeros > 1,
            torch.from_numpy(rng.integers(-1, nodes, samples)),
        )  # fmt: skip
        names = [f"behaviour {number}" for number in range(behaviours)]
        figure = recognition_over_time(recognition, names, 0.5, 0.1, "Episode")
        figure.savefig(tmp_path / "figure.png")
        (legend,) = figure.legends
        assert len(legend.get_texts()) == behaviours + 3
    with pytest.raises(ValueError, match="expected titles of 9 behaviours, got"):
        recognition_over_time(recognition, names[1:], 0.5, 0.1, "Episode")
    with pytest.raises(ValueError, match="expected timestep > 0"):
        recognition_over_time(recognition, names, 0.5, 0.0, "Episode")


def test_an_episode_without_anything_to_compare_it_with_can_be_drawn(tmp_path: Path):
    endless = make_recognition([1, 0, 1], [0.0, 0.5, 1.0], [0.1, math.inf, 2.0])
    figure = recognition_over_time(endless, BEHAVIOURS, 0.5, 0.1, "Episode")
    figure.savefig(tmp_path / "figure.png")
    assert figure.axes[2].get_ylim() == pytest.approx((0, 2.1))


def test_a_band_under_the_novelty_marks_where_the_robot_would_hold():
    acts = np.array([True, False, False, True, True])
    figure = recognition_over_time(RIGHT, BEHAVIOURS, 0.5, 0.1, "Episode", acts)
    novelty = figure.axes[2]
    _, band = novelty.collections
    vertices = band.get_paths()[0].vertices
    assert (vertices[:, 0].min(), vertices[:, 0].max()) == pytest.approx((0.1, 0.3))
    top = novelty.get_ylim()[0] + vertices[:, 1].max() * np.diff(novelty.get_ylim())[0]
    assert top < min(novelty.lines[0].get_ydata())
    assert figure.legends[0].get_texts()[-1].get_text() == "would hold, not act"


def test_each_node_has_its_number():
    winners = torch.arange(100) % 30
    recognition = make_recognition([0] * 100, [0.0] * 100, [0.1] * 100)._replace(winner=winners)
    figure = recognition_over_time(recognition, BEHAVIOURS, 0.5, 0.1, "Episode")
    labels = figure.axes[-1].get_yticklabels()
    assert [label.get_text() for label in labels] == [str(node) for node in range(30)]
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in labels]
    assert all(below.y1 < above.y0 + 1 for below, above in pairwise(boxes))  # [pixels]


def test_long_names_are_not_cut_off():
    task = "pick up the {} cube and place it carefully into the box on the far side of the table"
    names = [task.format(f"{colour} {shade}") for colour in ("red", "blue") for shade in range(6)]
    recognition = Recognition(
        torch.full((40, 12), 1 / 12), torch.zeros(40, dtype=torch.int64), *torch.zeros(4, 40),
        torch.zeros(40, dtype=torch.bool), torch.zeros(40, dtype=torch.int64),
    )  # fmt: skip
    figure = recognition_over_time(recognition, names, 0.5, 0.1, f"Episode 3, “{names[0]}”")
    figure.draw_without_rendering()
    title = figure.texts[0]
    for part in (title, *figure.legends[0].get_texts()):
        box = part.get_window_extent()
        assert figure.bbox.contains(box.x0, box.y0)
        assert figure.bbox.contains(box.x1, box.y1)
    shown = [text.get_text().replace("\n", " ") for text in figure.legends[0].get_texts()]
    assert shown[:12] == names
    assert figure.axes[0].get_window_extent().height > 1.1 * figure.dpi  # there is room for all


def test_an_episode_of_one_frame_is_visible():
    frame = Recognition(*(value[:1] for value in RIGHT))
    figure = recognition_over_time(frame, BEHAVIOURS, 0.5, 0.1, "Episode")
    for axes in figure.axes[1:]:
        (dot,) = [line for line in axes.lines if line.get_marker() == "."]
        assert len(dot.get_xdata()) == 1
        assert not dot.get_clip_on()  # it lies on the edge


def test_dollar_signs_in_names_are_no_formulas(tmp_path: Path):
    names = ("$x_1$ costs $", "lift\n\ta  cup")
    title = "Episode 1, “$x_1$ costs $”"
    figure = recognition_over_time(RIGHT, names, 0.5, 0.1, title)
    figure.savefig(tmp_path / "figure.png")  # "$ costs $" would be no formula
    (legend,) = figure.legends
    written = [figure.get_suptitle(), *(text.get_text() for text in legend.get_texts()[:2])]
    assert [cbook.is_math_text(text) for text in written] == [False] * 3
    shown = [text.replace(r"\$", "$") for text in written]
    assert shown == [title, names[0], "lift a cup"]


def test_large_novelty_stays_within_its_panel():
    far = RIGHT._replace(novelty=torch.tensor([0.2, 0.4, 2.0, 9.0, 0.1]))
    assert panels(far)[2].get_ylim()[1] > 9
    assert panels(RIGHT)[2].get_ylim() == (0, 1)
