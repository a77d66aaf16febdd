"""Figures of Experiment 2: positions, colours by cluster, labels."""

import io

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import same_color, to_hex
from matplotlib.figure import Figure

from pacnet.evaluation.figure_style import BLUE, GREY, INK, VERMILION
from train.walls import figures
from train.walls.forward_model_figures import calibration, fit_curves
from train.walls.scores import LEFT, NO_WALL, RIGHT

RATIO = np.array([0.7, 0.25, 0.05])
NAMES = [RIGHT, LEFT, NO_WALL, LEFT]
SENSORS = ["+90°", "+45°", "+12°", "-12°", "-45°", "-90°"]
TABLE = {
    "recall": {"wf": (0.9, 0.02), "tight": (0.8, 0.05)},
    "shuffled": {"wf": (0.6, 0.1), "tight": (0.4, 0.1)},
}
FIGURES = {
    figure.__name__: figure
    for figure in (
        figures.clusters_on_components,
        figures.activations_over_time,
        figures.trajectory,
        figures.conditions,
        calibration,
        fit_curves,
    )
}
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def cloud(rows: int, columns: int = 2, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, columns))


def examples() -> dict[str, tuple]:
    """Arguments for each figure."""
    return {
        "clusters_on_components": (cloud(4), np.array([[0, 1], [1, 3]]), cloud(50), NAMES, RATIO),
        "activations_over_time": (np.array([3, 0, -1, 2]), NAMES, 0.1),
        "trajectory": (
            [SQUARE],
            cloud(5, 3),
            np.array([1, 0, -1, -1, 0]),
            np.array([True, True, False, True, False]),
        ),
        "calibration": (cloud(300, 6), cloud(300, 6, 1), SENSORS),
        "conditions": (TABLE, {"recall": {"wf": 0.85}}),
        "fit_curves": (np.array([0.9, 0.5, 0.4]), np.array([0.9, 0.6, 0.7])),
    }


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def tick_labels(axis) -> list[str]:
    return [label.get_text() for label in axis.get_ticklabels()]


@pytest.mark.parametrize("name", examples())
def test_every_figure_renders_and_leaves_its_inputs_as_they_are(name):
    arguments, untouched = examples()[name], examples()[name]
    for value in arguments:
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    figure = FIGURES[name](*arguments)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=40)
    assert png.getvalue().startswith(b"\x89PNG")
    assert all(axes.get_title(loc="left") for axes in figure.axes)
    assert not hasattr(figure, "number")  # what pyplot gives to the figures it manages
    for value, before in zip(arguments, untouched, strict=True):
        np.testing.assert_equal(value, before)


def test_clusters_have_their_colours_edges_and_counts():
    nodes, edges, percepts = cloud(4), np.array([[0, 3], [1, 2]]), cloud(50, seed=1)
    figure = figures.clusters_on_components(nodes, edges, percepts, NAMES, RATIO)
    axes = figure.axes[0]
    (lines,) = (artist for artist in axes.collections if isinstance(artist, LineCollection))
    np.testing.assert_array_equal(lines.get_segments(), nodes[edges])
    behind, left, no_wall, right = (a for a in axes.collections if a is not lines)
    np.testing.assert_array_equal(behind.get_offsets(), percepts)
    for dots, own, colour in ((left, [1, 3], BLUE), (no_wall, [2], GREY), (right, [0], VERMILION)):
        np.testing.assert_array_equal(dots.get_offsets(), nodes[own])
        assert same_color(dots.get_facecolor()[0], colour)
    assert legend_of(figure) == ["left (2 nodes)", "no wall (1 node)", "right (1 node)"]
    assert [text.get_text() for text in axes.texts] == ["0", "1", "2", "3"]
    assert axes.get_xlabel() == "principal component 1 (70% of variance)"
    assert axes.get_aspect() == 1


@pytest.mark.parametrize(("count", "numbers"), [(0, 0), (40, 40), (41, 0)])
def test_many_nodes_are_not_numbered(count, numbers):
    no_edges = np.zeros((0, 2), int)
    figure = figures.clusters_on_components(cloud(count), no_edges, cloud(9), [LEFT] * count, RATIO)
    assert len(figure.axes[0].texts) == numbers


def test_activations_stand_in_the_rows_of_their_clusters():
    winners = np.array([0, 1, 2, 3, -1, 3, 0])  # rows: left 1, 3; no wall 2; right 0; no match
    (axes,) = figures.activations_over_time(winners, NAMES, 0.1).axes
    left, no_wall, right, none = (line for line in axes.lines if line.get_marker() == "|")
    np.testing.assert_array_equal(left.get_xydata(), [[1, 0], [3, 1], [5, 1]])
    np.testing.assert_array_equal(no_wall.get_xydata(), [[2, 2]])
    np.testing.assert_array_equal(right.get_xydata(), [[0, 3], [6, 3]])
    np.testing.assert_array_equal(none.get_xydata(), [[4, 4]])
    colours = [to_hex(line.get_color()) for line in (left, no_wall, right, none)]
    assert colours == [BLUE, GREY, VERMILION, INK]
    assert tick_labels(axes.yaxis) == ["1", "3", "2", "0", "no match"]
    assert [(text.get_text(), text.get_position()[1]) for text in axes.texts] == [
        (LEFT, 0.5),
        (NO_WALL, 2),
        (RIGHT, 3),
    ]
    bottom, top = axes.get_ylim()
    assert bottom > 4
    assert top < 0
    assert axes.get_xlabel() == "step of 0.1 s"


def test_a_row_for_steps_without_a_match_only_where_there_are_any():
    (axes,) = figures.activations_over_time(np.array([1, 1]), NAMES, 0.1).axes
    assert tick_labels(axes.yaxis) == ["1", "3", "2", "0"]
    bottom, _ = axes.get_ylim()
    assert 3 < bottom < 4


@pytest.mark.parametrize("winners", [[], [-1, -1], [3]])
def test_activations_of_few_steps_are_drawn(winners):
    (axes,) = figures.activations_over_time(np.array(winners, dtype=int), NAMES, 0.1).axes
    ticks = [line for line in axes.lines if line.get_marker() == "|"]
    assert sum(len(line.get_xdata()) for line in ticks) == len(winners)


def test_thirty_thousand_activations_are_all_there_and_rasterised():
    winners = np.random.default_rng(0).integers(-1, 4, 30_000)
    (axes,) = figures.activations_over_time(winners, NAMES, 0.1).axes
    ticks = [line for line in axes.lines if line.get_marker() == "|"]
    assert sum(len(line.get_xdata()) for line in ticks) == 30_000
    assert all(line.get_rasterized() for line in ticks)
    assert axes.get_title(loc="left") == "Winners in recall (30,000 steps, 50 min)"


def test_a_path_is_coloured_by_what_drove_each_step_and_by_its_wall():
    turn = np.linspace(0, 2 * np.pi, 7)
    poses = np.stack([np.cos(turn), np.sin(turn), turn], axis=1)
    side = np.array([1, 1, -1, 0, 1, -1, 0])
    commanded = np.array([True, True, True, True, False, False, True])
    figure = figures.trajectory([SQUARE, 2 * SQUARE], poses, side, commanded)
    (axes,) = figure.axes
    # The step to pose k leads from pose k - 1 and has the k-th colour.
    into = {GREY: [4, 5], figures.GREEN: [3, 6], BLUE: [1], VERMILION: [2]}
    for lines, (colour, steps) in zip(axes.collections, into.items(), strict=True):
        assert same_color(lines.get_color()[0], colour)
        expected = [[poses[step - 1, :2], poses[step, :2]] for step in steps]
        np.testing.assert_array_equal(lines.get_segments(), expected)
    start, end = axes.lines
    np.testing.assert_array_equal(start.get_xydata(), poses[:1, :2])
    np.testing.assert_array_equal(end.get_xydata(), poses[-1:, :2])
    for polygon, wall in zip(axes.patches, (SQUARE, 2 * SQUARE), strict=True):
        np.testing.assert_array_equal(polygon.get_xy(), [*wall, wall[0]])
        assert same_color(polygon.get_facecolor(), INK)
    assert axes.get_aspect() == 1
    assert {"default behaviour", "recalled, wall on the left", "start", "end"} < set(
        legend_of(figure)
    )


def test_a_path_of_one_step_without_walls_is_drawn():
    (axes,) = figures.trajectory([], np.zeros((1, 3)), np.array([0]), np.array([True])).axes
    assert [len(lines.get_segments()) for lines in axes.collections] == [0, 0, 0, 0]


def test_the_whole_arena_and_the_whole_path_are_in_view():
    poses = np.array([[0.5, 0.5, 0], [3.0, -0.5, 0]])
    figure = figures.trajectory([SQUARE], poses, np.zeros(2), np.ones(2, dtype=bool))
    figure.draw_without_rendering()
    (left, right), (low, high) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    assert left < 0
    assert right > 3
    assert low < -0.5
    assert high > 1


def bins_of(axes) -> tuple[np.ndarray, np.ndarray]:
    """Middles [B, 2] and half heights [B] of a calibration panel's bins."""
    (bars,) = axes.containers
    points, _, (whiskers,) = bars.lines
    heights = [segment[1, 1] - segment[0, 1] for segment in whiskers.get_segments()]
    return points.get_xydata(), np.array(heights) / 2


def test_a_perfect_model_lies_on_the_identity():
    change = cloud(2000, 6)
    figure = calibration(change, change, SENSORS)
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        f"{s}, R² 1.00" for s in SENSORS
    ]
    for axes in figure.axes:
        middles, spread = bins_of(axes)
        assert len(middles) >= 8
        np.testing.assert_allclose(middles[:, 0], middles[:, 1])
        assert (spread < 1).all()
    assert legend_of(figure) == ["perfect", "mean ± std"]


def test_calibration_shows_bias_spread_and_r_squared():
    predicted = np.repeat([[0.0], [1.0]], 50, axis=0)  # two bins of 50
    noise = np.tile([[-0.5], [0.5]], (50, 1))
    (axes,) = calibration(predicted, 2 * predicted + 1 + noise, ["front"]).axes
    middles, spread = bins_of(axes)
    np.testing.assert_allclose(middles, [[0, 1], [1, 3]])
    np.testing.assert_allclose(spread, 0.5)
    # Of true 0.5, 1.5, 2.5, 3.5 the mean square is 21 / 4, which is the error of persistence; that
    # of the prediction is (0.5^2 + 1.5^2 + 1.5^2 + 2.5^2) / 4 = 11 / 4: R² = 1 - 11 / 21
    assert axes.get_title(loc="left") == "front, R² 0.48"


def test_bins_of_few_samples_are_not_drawn():
    predicted = np.array([[0.0]] * 10 + [[1.0]] * 9)
    (axes,) = calibration(predicted, predicted, ["front"]).axes
    np.testing.assert_array_equal(bins_of(axes)[0], [[0, 0]])


def test_a_sensor_that_never_changes_has_no_r_squared():
    (axes,) = calibration(np.zeros((20, 1)), np.zeros((20, 1)), ["front"]).axes
    assert axes.get_title(loc="left") == "front, R² undefined"


@pytest.mark.parametrize(("sensors", "panels"), [(1, 1), (4, 4), (6, 6)])
def test_a_panel_for_each_sensor(sensors, panels):
    figure = calibration(cloud(50, sensors), cloud(50, sensors), SENSORS[:sensors])
    assert len(figure.axes) == panels


def test_conditions_have_bars_whiskers_numbers_and_what_is_wanted():
    wanted = {"shuffled": {"tight": 0.5}, "recall": {"wf": 0.85, "tight": 0.7}}
    figure = figures.conditions(TABLE, wanted)
    goals = {"wf": [(0, 0.85)], "tight": [(0, 0.7), (1, 0.5)]}
    for axes, score in zip(figure.axes, ("wf", "tight"), strict=True):
        means, stds = np.transpose([scores[score] for scores in TABLE.values()])
        assert [bar.get_width() for bar in axes.patches] == list(means)
        whiskers, marks = axes.collections
        ends = np.array(whiskers.get_segments())[:, :, 0]
        np.testing.assert_allclose(ends, np.stack([means - stds, means + stds], axis=1))
        drawn = [(segment[:, 1].mean(), segment[0, 0]) for segment in marks.get_segments()]
        np.testing.assert_allclose(drawn, goals[score])
        written = [text.get_text() for text in axes.texts]
        assert written == [f"{m:.2f} ± {s:.2f}" for m, s in zip(means, stds, strict=True)]
        assert score in axes.get_title(loc="left")
    assert tick_labels(figure.axes[0].yaxis) == list(TABLE)
    bottom, top = figure.axes[0].get_ylim()
    assert bottom > top  # the first condition is on top
    assert legend_of(figure) == ["wanted at least"]


def test_without_goals_nothing_is_marked():
    figure = figures.conditions(TABLE)
    assert not figure.legends
    assert all(not axes.collections[-1].get_segments() for axes in figure.axes)


def test_fit_curves_mark_the_epoch_of_the_least_validation_loss():
    train, validation = [0.9, 0.5, 0.3, 0.2], [1.0, 0.7, 0.65, 0.8]
    (axes,) = fit_curves(train, validation).axes
    curves = axes.lines
    np.testing.assert_array_equal(curves[0].get_xydata(), np.c_[[1, 2, 3, 4], train])
    np.testing.assert_array_equal(curves[1].get_xydata(), np.c_[[1, 2, 3, 4], validation])
    assert set(curves[2].get_xdata()) == {3}
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == ["training", "validation", "best epoch, 3: validation 0.650"]


@pytest.mark.parametrize(
    ("name", "position", "value", "message"),
    [
        ("clusters_on_components", 0, cloud(4, 3), r"nodes as numbers \[N, 2\]"),
        ("clusters_on_components", 1, [[0, 4]], "edges between nodes 0 to 3"),
        ("clusters_on_components", 1, [[-1, 2]], "edges between nodes 0 to 3"),
        ("clusters_on_components", 2, np.full((5, 2), np.nan), "finite percepts"),
        ("clusters_on_components", 3, [LEFT] * 3, "expected 4 names"),
        ("clusters_on_components", 3, [LEFT] * 3 + ["up"], "4 names out of"),
        ("activations_over_time", 0, np.array([4]), "winners below 4 nodes, got 4"),
        ("activations_over_time", 0, np.zeros(3), "winners as integers"),
        ("activations_over_time", 2, 0.0, "timestep > 0"),
        ("trajectory", 0, [np.zeros((4, 3))], r"walls as numbers \[P, 2\]"),
        ("trajectory", 1, cloud(5, 2), r"poses as numbers \[T, 3\]"),
        ("trajectory", 2, np.zeros(4), r"wall_side as numbers \[5\]"),
        ("trajectory", 2, np.full(5, 2), "sides -1, 0 or 1"),
        ("trajectory", 3, np.ones(6), r"commanded as numbers \[5\]"),
        ("calibration", 1, cloud(299, 6), r"true as numbers \[300, 6\]"),
        ("calibration", 2, SENSORS[:5], r"predicted as numbers \[T, 5\]"),
        ("conditions", 0, {}, "conditions with"),
        ("conditions", 0, {"recall": {"wf": (1, 0)}}, "conditions with"),
        ("conditions", 0, {"recall": {"wf": (np.nan, 0), "tight": (1, 0)}}, "finite wf"),
        ("conditions", 1, {"another": {"wf": 1}}, "wanted conditions out of"),
        ("fit_curves", 0, [0.1, 0.0, 0.1], "losses > 0"),
        ("fit_curves", 1, [0.1], r"validation_loss as numbers \[3\]"),
    ],
)
def test_bad_input_is_refused(name, position, value, message):
    arguments = list(examples()[name])
    arguments[position] = value
    with pytest.raises(ValueError, match=message):
        FIGURES[name](*arguments)


def test_nothing_to_draw_is_refused():
    with pytest.raises(ValueError, match="one or more steps"):
        figures.trajectory([SQUARE], np.zeros((0, 3)), [], [])
    with pytest.raises(ValueError, match="one or more samples"):
        calibration(np.zeros((0, 6)), np.zeros((0, 6)), SENSORS)
    with pytest.raises(ValueError, match="one or more epochs"):
        fit_curves([], [])
