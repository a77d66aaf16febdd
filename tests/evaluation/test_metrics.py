"""Measures against shapes whose values are known by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest

from pacnet.evaluation.metrics import (
    _alignment,
    aligned_distance,
    area_between_curves,
    path_distances,
)


def circle(radius: float, points: int) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, points + 1)
    return radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    return np.linalg.qr(rng.normal(size=(3, 3)))[0]


def test_area_between_parallel_lines_is_length_times_distance():
    time = np.random.default_rng(0).uniform(0, 2, 50)
    line = np.stack([2 * np.sort(np.r_[0, time, 2]) / 2, np.zeros(52)], axis=1)  # 2 m, any pace
    assert area_between_curves(line, line + np.array([0, 0.3])) == pytest.approx(0.6)


def test_area_between_concentric_circles():
    points = 200  # a polygon of n corners holds n/2 sin(2 pi/n) r^2, to 2 parts in 10,000 pi r^2
    area = area_between_curves(circle(2, points), circle(1, points))
    assert area == pytest.approx(3 * points / 2 * math.sin(2 * math.pi / points))
    assert area == pytest.approx(3 * math.pi, rel=2e-4)


@pytest.mark.parametrize("samples", [1001, 1000])  # the lines cross at a sample, between samples
def test_area_of_crossing_lines_is_that_of_both_triangles(samples):
    time = np.linspace(-1, 1, samples)
    flat, slanted = np.stack([time, 0 * time], axis=1), np.stack([time, time], axis=1)
    assert area_between_curves(flat, slanted) == pytest.approx(1.0, rel=2e-6)


def test_area_of_a_segment_turning_about_its_middle_is_the_documented_upper_estimate():
    # It sweeps the disc of radius 1, pi; between points that move oppositely triangles count twice.
    points = 500
    disc = points / 2 * math.sin(2 * math.pi / points)
    assert area_between_curves(circle(1, points)[:251], circle(1, points)[250:]) == pytest.approx(
        2 * disc
    )


def test_area_of_a_helicoid():
    # The segment from the axis to the helix (cos t, sin t, p t) sweeps a helicoid of area
    # turn * integral_0^1 sqrt(p^2 + r^2) dr = turn/2 (sqrt(1 + p^2) + p^2 asinh(1/p)).
    # Rails between axis and helix make each strip narrow enough for two triangles.
    pitch, turn = 0.5, np.linspace(0, np.pi, 2001)
    rails = [
        np.stack([r * np.cos(turn), r * np.sin(turn), pitch * turn], axis=1)
        for r in np.linspace(0, 1, 41)
    ]
    area = sum(area_between_curves(a, b) for a, b in pairwise(rails))
    exact = math.pi / 2 * (math.sqrt(1 + pitch**2) + pitch**2 * math.asinh(1 / pitch))
    assert area == pytest.approx(exact, rel=1e-3)


def test_area_ignores_frame_direction_and_which_path_is_which():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 30, 3))
    area = area_between_curves(a, b)
    turned = [path @ random_rotation(np.random.default_rng(2)).T + [1, 2, 3] for path in (a, b)]
    assert area_between_curves(*turned) == pytest.approx(area)
    assert area_between_curves(b, a) == pytest.approx(area)
    assert area_between_curves(a[::-1], b[::-1]) == pytest.approx(area)
    assert area_between_curves(3 * a, 3 * b) == pytest.approx(9 * area)
    assert area_between_curves(a, a) == 0


def test_area_in_the_plane_equals_area_in_space():
    a, b = np.random.default_rng(3).normal(size=(2, 30, 2))
    flat = [np.c_[path, np.full(30, 0.7)] for path in (a, b)]
    assert area_between_curves(*flat) == pytest.approx(area_between_curves(a, b))


def test_one_instant_sweeps_nothing():
    assert area_between_curves([[0.0, 0.0]], [[1.0, 1.0]]) == 0


def test_path_distances_of_the_same_instant():
    a = np.zeros((3, 3))
    b = np.array([[0, 0, 0], [3, 4, 0], [0, 0, 1]])  # distances 0, 5, 1
    assert path_distances(a, b) == (2.0, 5.0)
    assert path_distances(a, b).maximum == 5.0


def test_alignment_of_a_detour_by_hand():
    # 0 with 0; 1 with the detour (1, 3), 3 away, and nothing else; 2 with 2.
    reference, path = [[0.0, 0], [1, 0], [2, 0]], [[0.0, 0], [1, 3], [2, 0]]
    assert aligned_distance(reference, path) == pytest.approx(3 / 3)
    # The detour comes and goes: (1, 0) has partners at 0, 3 and 0, of which the mean is 1.
    path = [[0.0, 0], [1, 0], [1, 3], [1, 0], [2, 0]]
    assert aligned_distance(reference, path) == pytest.approx(1 / 3)
    # 1 goes to 0.2, which is nearer than 2.
    assert aligned_distance([[0.0], [1], [2]], [[0.2], [2.0]]) == pytest.approx((0.2 + 0.8 + 0) / 3)


def test_alignment_keeps_the_order():
    there_and_back = [[0.0], [1], [0]]
    # Any order would give 0; in order, 1 or 0 has to be left unmatched for one point.
    assert aligned_distance(there_and_back, [[0.0], [0], [1]]) == pytest.approx(1 / 3)


def test_a_path_that_waits_or_is_slow_is_as_near():
    time = np.linspace(0, 1, 41)
    slow, quick = (np.stack([t, np.sin(5 * t)], axis=1) for t in (time, time[::2]))
    assert aligned_distance(quick, quick) == 0
    assert aligned_distance(quick, np.repeat(quick, 3, axis=0)) == 0
    waits = np.concatenate([slow, np.repeat(slow[-1:], 400, axis=0)])
    assert aligned_distance(slow, waits) == 0
    up = np.array([0.0, 0.3])
    apart = aligned_distance(slow, slow + up)
    assert aligned_distance(slow, waits + up) == pytest.approx(apart, abs=0.02)


def test_a_path_that_stays_is_as_far_as_the_reference_goes():
    reference = np.array([[0.0, 0], [3, 4], [0, 0]])
    assert aligned_distance(reference, [[0.0, 0]]) == pytest.approx(5 / 3)
    assert aligned_distance([[0.0, 0]], reference) == pytest.approx(5 / 3)


def test_the_alignment_has_the_smallest_sum_of_all():
    def least(distances: np.ndarray) -> float:
        """Try every alignment."""
        rows, columns = distances.shape
        if rows == columns == 1:
            return distances[0, 0]
        rests = [distances[a:, b:] for a, b in ((1, 0), (0, 1), (1, 1)) if a < rows and b < columns]
        return distances[0, 0] + min(least(rest) for rest in rests)

    rng = np.random.default_rng(5)
    for rows, columns in ((1, 4), (4, 1), (4, 5), (5, 3)):
        distances = rng.uniform(size=(rows, columns))
        at, to = _alignment(distances)
        assert distances[at, to].sum() == pytest.approx(least(distances))
        assert (at[0], to[0], at[-1], to[-1]) == (0, 0, rows - 1, columns - 1)
        steps = np.stack([np.diff(at), np.diff(to)])
        assert steps.min() >= 0
        assert set(steps.max(axis=0).tolist()) <= {1}


@pytest.mark.parametrize(
    ("reference", "path", "message"),
    [
        (np.zeros((3, 3)), np.zeros((4, 2)), r"the path as numbers \[T, 3\], got .*\(4, 2\)"),
        (np.zeros((0, 3)), np.zeros((4, 3)), "at least one sample"),
        (np.zeros((3, 3)), np.zeros((0, 3)), "a path of at least one sample"),
        (np.zeros((3, 3)), np.full((3, 3), np.nan), "NaN or infinity"),
    ],
)
def test_paths_that_cannot_be_aligned_are_refused(reference, path, message):
    with pytest.raises(ValueError, match=message):
        aligned_distance(reference, path)


def test_inputs_stay_as_they_are():
    a, b = np.random.default_rng(4).normal(size=(2, 5, 3))
    copies = a.copy(), b.copy()
    for measure in (area_between_curves, path_distances, aligned_distance):
        measure(a, b)
    for value, copy in zip((a, b), copies, strict=True):
        np.testing.assert_array_equal(value, copy)


@pytest.mark.parametrize("measure", [area_between_curves, path_distances])
@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.zeros((3, 3)), np.zeros((4, 3)), r"second series as numbers \[3, 3\], got .*\(4, 3\)"),
        (np.zeros((3, 3)), np.full((3, 3), np.nan), "NaN or infinity"),
        (np.full((3, 3), np.inf), np.zeros((3, 3)), "NaN or infinity"),
        (np.zeros(3), np.zeros(3), r"series as numbers \[T, D\]"),
        (np.zeros((0, 3)), np.zeros((0, 3)), "at least one sample"),
        (np.zeros((3, 3), dtype=bool), np.zeros((3, 3)), "as numbers .* got bool"),
    ],
)
def test_bad_series_are_refused(measure, a, b, message):
    with pytest.raises(ValueError, match=message):
        measure(a, b)


def test_area_refuses_points_of_other_dimensions():
    with pytest.raises(ValueError, match="2 or 3 coordinates, got 4"):
        area_between_curves(np.zeros((5, 4)), np.zeros((5, 4)))
