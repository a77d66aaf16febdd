"""Scores of wall following against runs whose values are known by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from train.common.summary import summarise
from train.walls.scores import (
    LEFT,
    NO_WALL,
    RIGHT,
    SPEED,
    TEACHER_DISTANCE,
    TIMESTEP,
    WallRun,
    border_share,
    cluster_agreement,
    contact_share,
    energy,
    name_clusters,
    position_spread,
    score_run,
    side_changes,
    side_continuity,
    side_kept,
    sides_share,
    tight,
    wf,
)

STRIDE = 0.006  # the teacher's way in a step [m]


def make_run(steps: int = 10, **fields: object) -> WallRun:
    """The ideal run along a wall on the left, with these fields instead."""
    ideal = WallRun(
        poses=np.stack([STRIDE * np.arange(1, steps + 1), np.zeros(steps), np.zeros(steps)], 1),
        percepts=np.zeros((steps, 6)),
        wall_distance=np.full(steps, TEACHER_DISTANCE),
        wall_side=np.ones(steps, dtype=int),
        progress=np.full(steps, STRIDE),
        contact=np.zeros(steps, dtype=bool),
        winners=np.zeros(steps, dtype=int),
        commanded=np.ones(steps, dtype=bool),
    )
    return replace(ideal, **fields)


def test_a_run_like_the_teachers_scores_one():
    assert pytest.approx(STRIDE) == SPEED * TIMESTEP
    run = make_run()
    assert [wf(run), tight(run), energy(run)] == pytest.approx([1, 1, 1])


def test_a_robot_that_stands_still_has_no_energy():
    run = make_run(progress=np.zeros(10))
    assert [wf(run), tight(run), energy(run)] == [0, 0, 0]


def test_wf_and_tight_count_the_progress_in_their_bands():
    distance = np.array([0.007, 0.009, 0.017, 0.019, 0.033, 0.035, 0.049, 0.051])
    progress = np.array([1, 2, 4, 8, 16, 32, 64, 128]) / 1000
    run = make_run(8, wall_distance=distance, progress=progress)
    assert wf(run) == pytest.approx((0.002 + 0.004 + 0.008 + 0.016 + 0.032 + 0.064) / 0.048)
    assert tight(run) == pytest.approx((0.008 + 0.016) / 0.048)


def test_energy_falls_off_about_the_teachers_distance_and_below_its_speed():
    distance = TEACHER_DISTANCE + np.array([0, 0.01, -0.01, 0.02, 0])
    progress = np.array([0.012, 0.006, 0.006, 0.006, 0.003])  # twice the speed earns no more
    run = make_run(5, wall_distance=distance, progress=progress)
    by_hand = (1 + math.exp(-0.5) + math.exp(-0.5) + math.exp(-2) + 0.5) / 5
    assert energy(run) == pytest.approx(by_hand)


def test_energy_is_bounded():
    rng = np.random.default_rng(0)
    distance, progress = rng.uniform(-0.01, 1, 200), rng.uniform(0, 0.1, 200)
    assert 0 < energy(make_run(200, wall_distance=distance, progress=progress)) < 1
    assert energy(make_run(progress=np.full(10, 10 * STRIDE))) == pytest.approx(1)


def test_contact_share():
    assert contact_share(make_run(4, contact=np.array([True, False, False, False]))) == 0.25


SIDES = np.array([1, 1, 0, 1, -1, -1, 1, 1])
STRIDES = np.array([6, 6, 6, 2.9, 6, 6, 2.9, 6]) / 1000  # along walls: 1 1 . . -1 -1 . 1


def test_side_kept_counts_only_steps_along_walls():
    run = make_run(8, wall_side=SIDES, progress=STRIDES)
    assert side_kept(run, 1) == pytest.approx(3 / 5)
    assert side_kept(run, -1) == pytest.approx(2 / 5)
    assert sides_share(run) == {LEFT: side_kept(run, 1), RIGHT: side_kept(run, -1)}


def test_continuity_and_changes_skip_steps_between_walls():
    run = make_run(8, wall_side=SIDES, progress=STRIDES)
    assert side_continuity(run) == pytest.approx(2 / 4)
    assert side_changes(run) == pytest.approx(1000 * 2 / 8)
    apart = make_run(3, wall_side=np.array([1, 0, 1]))
    assert (side_continuity(apart), side_changes(apart)) == (1, 0)


@pytest.mark.parametrize("steps", [1, 6])
def test_a_run_that_is_never_along_a_wall_keeps_no_side(steps):
    run = make_run(steps, wall_side=np.zeros(steps, dtype=int))
    assert side_continuity(run) == side_changes(run) == 0
    assert sides_share(run) == {LEFT: 0, RIGHT: 0}


def test_mirroring_a_run_swaps_its_sides_and_changes_nothing_else():
    rng = np.random.default_rng(1)
    sides, strides = rng.integers(-1, 2, 100), rng.uniform(0, 0.006, 100)
    run = make_run(100, wall_side=sides, progress=strides)
    mirrored, scores = score_run(replace(run, wall_side=-sides)), score_run(run)
    scores["left_share"], scores["right_share"] = scores["right_share"], scores["left_share"]
    assert mirrored == scores


def test_position_spread_is_the_diagonal_of_the_narrowest_window():
    poses = make_run(30).poses
    poses[10:15, 0] = 1.0  # five steps ...
    poses[10:15, 1] = [2.0, 2.04, 2.0, 2.0, 2.0]  # ... in a box of 0 by 40 mm
    poses[12, 0] = 1.03  # ... of 30 by 40 mm
    poses[[9, 15]] = 5.0
    poses[:9, 1], poses[16:, 1] = np.linspace(0, 9, 9), np.linspace(0, 9, 14)
    assert position_spread(make_run(30, poses=poses), 5) == pytest.approx(0.05)


@pytest.mark.parametrize("window", [1, 2, 7, 40])
def test_position_spread_as_a_plain_loop_finds_it(window):
    poses = np.random.default_rng(2).normal(size=(40, 3)).cumsum(axis=0)
    boxes = [poses[start : start + window, :2] for start in range(41 - window)]
    diagonals = [math.dist(box.min(axis=0), box.max(axis=0)) for box in boxes]
    assert position_spread(make_run(40, poses=poses), window) == pytest.approx(min(diagonals))


def test_a_turning_robot_is_stuck_and_a_moving_one_is_not():
    poses = np.zeros((600, 3))
    poses[:, 2] = np.arange(600)
    assert position_spread(make_run(600, poses=poses)) == 0
    assert position_spread(make_run(600)) == pytest.approx(499 * STRIDE)
    assert position_spread(make_run(100)) == pytest.approx(99 * STRIDE)  # one window


def test_nodes_are_named_by_their_strongest_side():
    prototypes = np.array(
        [
            [0.55, 0.2, 0, 0, 0, 0],
            [0, 0, 0, 0, 0.2, 0.55],
            [0.09, 0.09, 0.09, 0, 0, 0.09],  # the strongest, not the sum
            [0.5, 0, 0, 0.3, 0.2, 0.1],  # the sum, not the strongest
            [0, 0, 0.1, 0, 0, 0],
            [0.3, 0, 0, 0, 0, 0.3],
        ]
    )
    assert name_clusters(prototypes) == [LEFT, RIGHT, NO_WALL, RIGHT, LEFT, LEFT]
    assert name_clusters(np.zeros((0, 6))) == []


def test_the_naming_threshold_is_a_wall_at_the_reach_of_wall_side():
    # IR: three rays at 0 and ±15 degrees, sigmoid((30 - d) / 10 mm), 1 at contact; a flat wall.
    def reading(distance: float) -> float:
        rays = [distance / math.cos(math.radians(turn)) for turn in (-15, 0, 15)]
        return sum((1 + math.exp(-3)) / (1 + math.exp((d - 0.03) / 0.01)) for d in rays) / 3

    assert name_clusters([[reading(0.050), 0, 0, 0, 0, 0]]) == [LEFT]
    assert name_clusters([[reading(0.052), 0, 0, 0, 0, 0]]) == [NO_WALL]


def test_agreement_compares_each_winner_with_the_place_that_it_saw():
    names = [LEFT, NO_WALL, RIGHT]
    side = np.array([1, 0, -1, 1, 1])  # after each step
    seen = np.array([2, 0, 1, 2, 0])  # before each step; the first saw what the run does not hold
    assert cluster_agreement(make_run(5, wall_side=side, winners=seen), names) == 1
    unmatched = np.array([2, -1, 1, 0, 0])  # of three winners that count, one is wrong
    run = make_run(5, wall_side=side, winners=unmatched)
    assert cluster_agreement(run, names) == pytest.approx(2 / 3)
    assert cluster_agreement(make_run(5, winners=np.full(5, -1)), names) == 0


def test_border_cases_are_counted_and_not_left_out():
    distance = np.array([0.044, 0.046, 0.054, 0.056])
    run = make_run(4, wall_distance=distance, wall_side=np.array([1, 1, 0, 0]))
    assert border_share(run) == 0.5
    assert cluster_agreement(run, [LEFT]) == pytest.approx(2 / 3)  # the third saw no wall


def test_a_runs_scores_are_finite_numbers_for_json():
    scores = score_run(make_run(1, winners=np.array([-1]), wall_side=np.array([0])))
    assert all(type(value) is float and math.isfinite(value) for value in scores.values())


def test_a_runs_scores_are_those_of_the_functions_and_shares():
    rng = np.random.default_rng(3)
    run = make_run(
        100,
        wall_distance=rng.uniform(0, 0.06, 100),
        wall_side=rng.integers(-1, 2, 100),
        progress=rng.uniform(0, 0.006, 100),
        contact=np.arange(100) < 1,
        winners=np.where(np.arange(100) < 70, 4, -1),
        commanded=np.arange(100) < 60,
    )
    assert score_run(run) == {
        "wf": wf(run),
        "tight": tight(run),
        "energy": energy(run),
        "contact_share": 0.01,
        "left_share": side_kept(run, 1),
        "right_share": side_kept(run, -1),
        "side_continuity": side_continuity(run),
        "side_changes_per_1000_steps": side_changes(run),
        "position_spread_m": position_spread(run),
        "border_share": border_share(run),
        "matched_share": 0.7,
        "commanded_share": 0.6,
    }


def test_summary_over_replicates():
    summary = summarise(
        [{"wf": 1.0, "tight": 0.5}, {"wf": 2.0, "tight": 0.5}, {"wf": 6.0, "tight": 0.5}]
    )
    assert summary["wf"]["values"] == [1, 2, 6]
    assert summary["wf"]["mean"] == pytest.approx(3)
    assert summary["wf"]["std"] == pytest.approx(math.sqrt((4 + 1 + 9) / 2))
    assert summary["tight"]["std"] == 0
    assert summarise([{"wf": 1.0}])["wf"] == {"mean": 1.0, "std": 0.0, "values": [1.0]}


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("poses", np.zeros((10, 2)), r"poses .* shape \[10, 3\] .* got float64 \[10, 2\]"),
        ("percepts", np.zeros((9, 6)), r"percepts .* shape \[10, 6\]"),
        ("wall_distance", np.full(10, np.inf), "finite floats"),
        ("wall_side", np.ones(10), "wall_side as finite integers"),
        ("wall_side", np.full(10, 2), "wall_side of -1, 0 or 1"),
        ("progress", np.full(10, -0.001), "progress ≥ 0"),
        ("contact", np.zeros(10, dtype=int), "contact as finite booleans"),
        ("winners", np.full(10, -2), "winners ≥ -1"),
        ("commanded", [True] * 10, "commanded .* got list"),
    ],
)
def test_a_run_refuses_what_does_not_fit(field, value, message):
    with pytest.raises(ValueError, match=message):
        make_run(10, **{field: value})


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: make_run(0), "T ≥ 1"),
        (lambda: side_kept(make_run(), 0), "side 1 .left. or -1 .right., got 0"),
        (lambda: position_spread(make_run(), 0), "window ≥ 1"),
        (lambda: name_clusters(np.zeros((3, 5))), r"shape \[N, 6\], got \(3, 5\)"),
        (lambda: name_clusters(np.full((1, 6), np.nan)), "finite prototypes"),
        (lambda: cluster_agreement(make_run(), []), "nodes 0 to 0, got 0 names"),
        (lambda: cluster_agreement(make_run(), ["up"]), "names out of"),
        (lambda: summarise([]), "one or more replicates"),
        (lambda: summarise([{"wf": 1.0}, {"tight": 1.0}]), "the same scores"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
