"""Measures against shapes and sequences whose values are known by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest

from pacnet.evaluation.metrics import (
    area_between_curves,
    area_under_roc,
    joint_rms,
    order_agreement,
    path_distances,
    switches,
    winner_order,
)

A, B, C, NONE = 0, 1, 2, -1


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


def test_joint_rms_in_degrees():
    a = np.zeros((2, 2))
    b = np.radians([[3.0, 0.0], [4.0, 0.0]])
    rms = joint_rms(a, b)
    assert rms.per_joint == pytest.approx((math.sqrt(12.5), 0.0))
    assert rms.whole == pytest.approx(2.5)  # sqrt((9 + 16) / 4)


@pytest.mark.parametrize(
    ("winners", "order"),
    [
        ([A] * 4 + [B] + [A] * 4, (A,)),
        ([A] * 4 + [B, A] + [B] * 4, (A, B)),
        ([A] * 3 + [B] * 3 + [A] * 3, (A, B, A)),
        ([A] * 3 + [B] * 2 + [C] * 3, (A, C)),
        ([A, B] * 20, ()),
        ([A, A, NONE, NONE, A, B, B, B], (A, B)),
        ([NONE] * 9, ()),
        ([C], ()),
        ([], ()),
    ],
)
def test_winner_order_drops_flicker_then_merges(winners, order):
    assert winner_order(np.array(winners, dtype=int)) == order


def test_winner_order_with_every_run_counting():
    assert winner_order([A, A, B, NONE, B, A], min_run=1) == (A, B, A)


@pytest.mark.parametrize(
    ("one", "other", "agreement"),
    [
        ((0, 1, 2, 3), (0, 1, 2, 3), 1.0),
        ((0, 1, 2, 3), (3, 2, 1, 0), 0.25),
        ((0, 1, 2, 3), (0, 2, 3), 0.75),
        ((0, 1, 2), (0, 9, 1, 9, 2, 9), 0.5),
        ((5, 6), (7, 8), 0.0),
        ((5, 5), (5,), 0.5),
        ((1, 2, 3, 2, 4, 1, 2), (2, 4, 3, 1, 2, 1), 4 / 7),  # Cormen et al.'s example: 2 3 2 1
        ((), (1,), 0.0),
        ((), (), 1.0),
    ],
)
def test_order_agreement(one, other, agreement):
    assert order_agreement(one, other) == pytest.approx(agreement)
    assert order_agreement(other, one) == pytest.approx(agreement)


@pytest.mark.parametrize(
    ("winners", "count"),
    [
        ([A, A, B, A], 2),
        ([A, NONE, A], 0),
        ([A, NONE, B], 1),
        ([NONE, NONE], 0),
        ([A], 0),
        ([], 0),
    ],
)
def test_switches_counts_changes_of_winner(winners, count):
    assert switches(np.array(winners, dtype=int)) == count


def test_inputs_stay_as_they_are():
    a, b = np.random.default_rng(4).normal(size=(2, 5, 3))
    winners = np.array([A, NONE, B])
    copies = a.copy(), b.copy(), winners.copy()
    for measure in (area_between_curves, path_distances, joint_rms):
        measure(a, b)
    winner_order(winners), switches(winners), order_agreement(winners, winners)
    for value, copy in zip((a, b, winners), copies, strict=True):
        np.testing.assert_array_equal(value, copy)


@pytest.mark.parametrize("measure", [area_between_curves, path_distances, joint_rms])
@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.zeros((3, 3)), np.zeros((4, 3)), r"one shape, got \(3, 3\) and \(4, 3\)"),
        (np.zeros((3, 3)), np.full((3, 3), np.nan), "NaN or infinity"),
        (np.full((3, 3), np.inf), np.zeros((3, 3)), "NaN or infinity"),
        (np.zeros(3), np.zeros(3), r"series \[T, D\]"),
        (np.zeros((0, 3)), np.zeros((0, 3)), "at least one sample"),
        (np.zeros((3, 3), dtype=bool), np.zeros((3, 3)), "real numbers, got bool"),
    ],
)
def test_bad_series_are_refused(measure, a, b, message):
    with pytest.raises(ValueError, match=message):
        measure(a, b)


def test_area_wants_points_of_the_plane_or_space():
    with pytest.raises(ValueError, match="2 or 3 coordinates, got 4"):
        area_between_curves(np.zeros((5, 4)), np.zeros((5, 4)))


@pytest.mark.parametrize("measure", [winner_order, switches, lambda w: order_agreement(w, w)])
@pytest.mark.parametrize("winners", [np.zeros(3), np.zeros((3, 1), dtype=int), 4, ["a"]])
def test_bad_winners_are_refused(measure, winners):
    with pytest.raises(ValueError, match="as integers"):
        measure(winners)


def test_a_run_has_at_least_one_sample():
    with pytest.raises(ValueError, match="min_run ≥ 1"):
        winner_order([A], min_run=0)


def test_area_under_roc_equals_counting_all_pairs():
    generator = np.random.default_rng(0)
    known, new = generator.integers(0, 6, 40), generator.integers(2, 9, 30)
    pairs = [1.0 if n > k else 0.5 if n == k else 0.0 for k in known for n in new]
    assert area_under_roc(known, new) == pytest.approx(np.mean(pairs))
    assert area_under_roc([0.0, 1.0], [2.0, 3.0]) == 1.0
    assert area_under_roc([2.0, 3.0], [0.0, 1.0]) == 0.0


@pytest.mark.parametrize(
    ("known", "new", "name"),
    [([], [1.0], "known"), ([1.0], [np.nan], "new"), ([[1.0]], [1.0], "known")],
)
def test_area_under_roc_of_no_scores_is_refused(known: list, new: list, name: str):
    with pytest.raises(ValueError, match=f"expected {name} as one or more finite numbers"):
        area_under_roc(known, new)
