"""Figures of the map: artists, labels, limits, and no global state."""

import io
import sys

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Text

from pacnet.evaluation import map_figures as figures

RATIO = np.array([0.6, 0.2, 0.1])


def cloud(rows: int, columns: int = 2, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, columns))


def examples() -> dict[str, tuple]:
    """Arguments for each figure."""
    return {
        "percepts_on_components": (cloud(50), np.arange(50.0), RATIO),
        "map_on_components": (cloud(6), np.array([[0, 1], [1, 4]]), cloud(50), RATIO),
        "winners_over_time": (np.array([3, 3, -1, 5]), 0.1, np.array([5, 3, 3])),
    }


def arrays_in(arguments: tuple) -> list[np.ndarray]:
    return [value for value in arguments if isinstance(value, np.ndarray)]


def written(axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


@pytest.mark.parametrize("name", examples())
def test_every_figure_renders_with_titles_and_labels(name):
    figure = getattr(figures, name)(*examples()[name])
    assert isinstance(figure, Figure)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=40)
    assert png.getvalue().startswith(b"\x89PNG")
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert panels
    assert all(axes.get_xlabel() for axes in panels)


@pytest.mark.parametrize("name", examples())
def test_inputs_stay_as_they_are(name):
    arguments, untouched = examples()[name], examples()[name]
    for value in arrays_in(arguments):
        value.setflags(write=False)
    getattr(figures, name)(*arguments)
    for value, before in zip(arrays_in(arguments), arrays_in(untouched), strict=True):
        np.testing.assert_array_equal(value, before)


@pytest.mark.parametrize("name", examples())
def test_no_figure_is_kept_by_pyplot(name):
    figure = getattr(figures, name)(*examples()[name])
    assert not hasattr(figure, "number")  # what pyplot gives to the figures it manages
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()


def test_percepts_are_coloured_by_their_time():
    points, times = cloud(50), np.linspace(0, 9, 50)
    axes, bar = figures.percepts_on_components(points, times, RATIO).axes
    (dots,) = axes.collections
    np.testing.assert_array_equal(dots.get_offsets(), points)
    np.testing.assert_array_equal(dots.get_array(), times)
    assert bar.get_ylabel() == "time in episode [s]"
    assert axes.get_xlabel() == "principal component 1 (60% of variance)"
    assert axes.get_ylabel() == "principal component 2 (20% of variance)"


def test_map_joins_the_right_nodes_and_numbers_each():
    nodes, edges = cloud(12), np.array([[0, 3], [3, 11], [5, 6]])
    axes = figures.map_on_components(nodes, edges, cloud(200, seed=1), RATIO).axes[0]
    (lines,) = (artist for artist in axes.collections if isinstance(artist, LineCollection))
    np.testing.assert_array_equal(lines.get_segments(), nodes[edges])
    assert written(axes) == [str(node) for node in range(12)]
    np.testing.assert_array_equal([text.xy for text in axes.texts], nodes)
    assert axes.get_aspect() == 1


def test_node_numbers_do_not_overlap_even_where_nodes_do():
    nodes = cloud(20)
    nodes[[4, 9, 13]] = nodes[2] + [[0.02, 0], [0, 0.02], [0, 0]]
    figure = figures.map_on_components(nodes, np.zeros((0, 2), int), cloud(99), RATIO)
    figure.draw_without_rendering()
    texts = figure.axes[0].texts
    boxes = [Text.get_window_extent(text) for text in texts]  # without the pointer to the node
    overlaps = [(i, j) for i in range(20) for j in range(i) if boxes[i].overlaps(boxes[j])]
    assert overlaps == []
    assert all(figure.axes[0].bbox.overlaps(box) for box in boxes)


@pytest.mark.parametrize("count", [0, 1])
def test_a_map_of_none_or_one_node_is_drawn(count):
    figure = figures.map_on_components(cloud(count), np.zeros((0, 2), int), cloud(1), [0, 0])
    assert len(figure.axes[0].texts) == count


def test_winners_climb_in_order_of_first_win():
    winners = np.array([7, 7, 2, 2, -1, 7, 9])
    (axes,) = figures.winners_over_time(winners, 0.5).axes
    won, unmatched = axes.lines
    np.testing.assert_allclose(won.get_xdata(), [0, 0.5, 1, 1.5, 2.5, 3])
    np.testing.assert_array_equal(won.get_ydata(), [0, 0, 1, 1, 0, 2])
    np.testing.assert_allclose(unmatched.get_xdata(), [2])
    assert [label.get_text() for label in axes.get_yticklabels()] == ["no match", "7", "2", "9"]
    np.testing.assert_array_equal(axes.get_yticks(), [-1, 0, 1, 2])
    assert unmatched.get_ydata() == [-1]
    low, high = axes.get_ylim()
    assert low < -1
    assert high > 2


def test_demonstration_sets_the_rows_of_both_panels():
    figure = figures.winners_over_time(np.array([3, 1, 8]), 0.1, np.array([1, 1, 3]))
    shown, recalled = figure.axes
    assert "demonstration" in shown.get_title(loc="left")
    assert [label.get_text() for label in shown.get_yticklabels()] == ["1", "3", "8"]
    np.testing.assert_array_equal(shown.lines[0].get_ydata(), [0, 0, 1])
    np.testing.assert_array_equal(recalled.lines[0].get_ydata(), [1, 0, 2])


@pytest.mark.parametrize("winners", [[], [-1, -1], [4]])
def test_winners_of_few_samples_are_drawn(winners):
    figure = figures.winners_over_time(np.array(winners, dtype=int), 0.1)
    assert len(figure.axes[0].lines[0].get_xdata()) == sum(node >= 0 for node in winners)


@pytest.mark.parametrize(
    ("name", "position", "value", "message"),
    [
        ("percepts_on_components", 0, cloud(50, 3), r"percepts as numbers \[T, 2\], got .*\(50, 3"),
        ("percepts_on_components", 1, np.zeros(49), r"times as numbers \[50\], got .*\(49,\)"),
        ("percepts_on_components", 0, np.full((50, 2), np.nan), "finite percepts"),
        ("percepts_on_components", 2, [0.9], "two or more components, got 1"),
        ("map_on_components", 1, [[0, 6]], "edges between nodes 0 to 5"),
        ("map_on_components", 1, [[-1, 2]], "edges between nodes 0 to 5"),
        ("winners_over_time", 0, np.zeros(3), "winners as integers"),
        ("winners_over_time", 1, 0.0, "timestep > 0"),
        ("winners_over_time", 2, np.zeros((2, 2), int), "winners as integers"),
    ],
)
def test_bad_input_is_refused(name, position, value, message):
    arguments = list(examples()[name])
    arguments[position] = value
    with pytest.raises(ValueError, match=message):
        getattr(figures, name)(*arguments)
