"""The novelty detector: what is novel, in which dimension, and how thresholds are learned."""

import math
from copy import deepcopy

import numpy as np
import pytest
import torch

from pacnet.imitator.novelty import MARGIN, RATE, NoveltyDetector

FRAMES = 200


def rows(*values):
    return np.array(values, dtype=np.float32)


def swing(seed, place=0.0, noise=0.02):
    """An arm that swings out and back beside a glass, and a dimension that never changes."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 2 * np.pi * rng.uniform(0.95, 1.05), FRAMES)
    path = np.stack([np.sin(time), np.cos(time), np.full(FRAMES, place)], axis=1)
    noisy = path + noise * rng.standard_normal(path.shape)
    return np.column_stack([noisy, np.full(FRAMES, 0.73)]).astype(np.float32)


def trained(*episodes):
    """What has learned these episodes, and all their percepts as cues."""
    detector = NoveltyDetector(episodes[0].shape[1])
    cues = episodes[0][:0]
    for episode in episodes:
        detector.learn(episode, cues)
        cues = np.concatenate([cues, episode])
    return detector, cues


def score_all(detector, percepts, cues):
    detector.reset()
    return [detector.score(percept, cues) for percept in percepts]


def novelties(detector, percepts, cues):
    return np.array([score.novelty for score in score_all(detector, percepts, cues)])


def test_scores_match_a_calculation_by_hand():
    detector = NoveltyDetector(2)
    # Both dimensions change from frame to frame by as much each time: 1 and 2.
    assert detector.learn(rows([0, 0], [1, 2], [2, 4]), None) is None
    assert detector.thresholds == pytest.approx([4, 8])
    cues = rows([0, 0], [10, 10])
    # The second cue is nearer, (1, −4) away; a tenth of that is followed, then 0.19 of it.
    first, second = score_all(detector, rows([11, 6], [11, 6]), cues)
    assert first == pytest.approx((0.4 / 8, 1, -4, 8))
    assert second == pytest.approx((0.76 / 8, 1, -4, 8))


def test_typical_deviations_match_a_calculation_by_hand():
    detector, known = NoveltyDetector(1), rows([0], [1], [2])
    detector.learn(known, None)  # 1 from frame to frame
    # 8 from the nearest, then 4 on the other side: 0.8, then 0.9 · 0.8 + 0.1 · 4 = 1.12.
    assert detector.learn(rows([10], [-4]), known) == pytest.approx(1.12 / 4)
    assert detector.typical_deviation == pytest.approx([1])  # the lower median of 1 and 1.12
    detector.learn(rows([2], [8]), known)  # 0, then 0.1 · 6 = 0.6
    assert detector.typical_deviation == pytest.approx([1])  # the median of 1, 1.12 and 0.6
    detector.learn(rows([2], [1]), known)  # 0
    assert detector.typical_deviation == pytest.approx(
        [0.6]
    )  # the lower median of 0, 0.6, 1 and 1.12
    detector.learn(rows([50]), known)  # one frame shows nothing
    assert detector.typical_deviation == pytest.approx([0.6])
    for _ in range(2):
        detector.learn(rows([2], [1]), known)  # of 0, 0, 0, 0.6, 1 and 1.12 it is 0
    assert detector.typical_deviation == pytest.approx(
        [0.25]
    )  # a quarter of what the first one moved by


def test_the_first_episode_matches_a_calculation_by_hand():
    steps = np.where(np.arange(100) % 20 == 0, 3.0, 1.0)  # five of a hundred are of 3
    path = np.concatenate([[0], np.cumsum(steps)])
    detector = NoveltyDetector(2)
    detector.learn(np.stack([path, np.full(101, 7)], axis=1).astype(np.float32), None)
    # Where nothing changed, a tenth of the quadratic mean of 3 and 0 is typical.
    assert detector.typical_deviation == pytest.approx([3, 0.1 * 3 / math.sqrt(2)])


def test_the_novelty_of_an_episode_uses_the_thresholds_before_it():
    detector, cues = trained(swing(0))
    before, percepts = detector.thresholds, swing(1)
    expected = novelties(detector, percepts, cues).max()
    assert detector.learn(percepts, cues) == pytest.approx(expected, rel=1e-5)
    assert (detector.thresholds != before).any()


def test_the_nearest_is_found_far_from_the_origin_too():
    rng = np.random.default_rng(0)
    cues = (1e4 + rng.standard_normal((300, 3))).astype(np.float32)
    percepts = (1e4 + rng.standard_normal((50, 3))).astype(np.float32)
    detector = NoveltyDetector(3)
    detector.learn(percepts, None)
    thresholds = detector.thresholds.copy()
    followed, largest = np.zeros(3), np.zeros(3)
    for percept in percepts.astype(np.float64):  # a second method: one by one, in float64
        apart = percept - cues
        followed += RATE * (abs(apart[(apart**2).sum(axis=1).argmin()]) - followed)
        largest = np.maximum(largest, followed)
    assert detector.learn(percepts, cues) == pytest.approx((largest / thresholds).max(), rel=1e-3)


def test_more_of_the_same_is_known_and_another_place_is_novel():
    detector, cues = trained(*map(swing, range(8)))
    for seed in range(100, 110):
        assert novelties(detector, swing(seed), cues).max() < 0.8
    scores = score_all(detector, swing(100, place=1.0), cues)[10:]
    assert all(one.novelty > 1 and one.dimension == 2 for one in scores)
    assert np.mean([one.deviation for one in scores]) == pytest.approx(1, abs=0.1)


def test_one_demonstration_is_enough_to_begin_with():
    detector, cues = trained(swing(0))
    assert novelties(detector, swing(0), cues).max() == 0
    for seed in range(100, 105):
        assert novelties(detector, swing(seed), cues).max() < 1
    assert novelties(detector, swing(100, place=1.0), cues)[10:].min() > 1


def test_dimensions_keep_their_order():
    order = [3, 1, 0, 2]
    detector, cues = trained(*map(swing, range(4)))
    turned, turned_cues = trained(*(swing(seed)[:, order] for seed in range(4)))
    assert turned.thresholds == pytest.approx(detector.thresholds[order])
    percepts = swing(9, place=0.5)
    for one, other in zip(
        score_all(detector, percepts, cues),
        score_all(turned, percepts[:, order], turned_cues),
        strict=True,
    ):
        assert other.novelty == pytest.approx(one.novelty, rel=1e-4)
        assert order[other.dimension] == one.dimension


def test_a_novel_episode_raises_no_threshold():
    detector, cues = trained(*map(swing, range(8)))
    before, known = detector.thresholds, novelties(detector, swing(100), cues)
    for seed, place in enumerate((1.0, -1.0, 2.0)):
        percepts = swing(50 + seed, place=place)
        assert detector.learn(percepts, cues) > 1
        cues = np.concatenate([cues, percepts])
    assert (detector.thresholds < 1.5 * before).all()
    assert novelties(detector, swing(100), cues) == pytest.approx(known, abs=0.2)
    assert novelties(detector, swing(101, place=0.5), cues)[10:].min() > 1
    assert novelties(detector, swing(101, place=1.0), cues).max() < 1  # known by now


def test_a_second_episode_that_is_novel_raises_no_threshold():
    detector, cues = trained(swing(0))
    before = detector.thresholds
    detector.learn(swing(1, place=5.0), cues)
    assert (detector.thresholds <= before + 1e-6).all()


@pytest.mark.parametrize("count", [1, 2, 4])
def test_corrections_raise_no_threshold_even_if_they_outnumber_the_rest(count):
    detector, cues = trained(*map(swing, range(count)))
    before = detector.thresholds
    for seed in range(2 * count):
        percepts = swing(50 + seed, place=1.0 + seed)
        assert detector.learn(percepts, cues, correction=True) > 1
        cues = np.concatenate([cues, percepts])
    assert np.array_equal(detector.thresholds, before)
    assert novelties(detector, swing(101, place=-1.0), cues)[10:].min() > 1


def test_the_first_episode_sets_the_thresholds_even_as_a_correction():
    one, other = NoveltyDetector(4), NoveltyDetector(4)
    one.learn(swing(0), None)
    other.learn(swing(0), None, correction=True)
    assert np.array_equal(one.thresholds, other.thresholds)


def test_thresholds_are_high_where_demonstrations_vary_much():
    places = np.random.default_rng(0).uniform(-1, 1, 8)
    detector, cues = trained(*(swing(i, place) for i, place in enumerate(places)))
    narrow, _ = trained(*map(swing, range(8)))
    assert detector.thresholds[2] > 2 * narrow.thresholds[2]
    middle = (np.sort(places)[1:] + np.sort(places)[:-1]) / 2
    assert novelties(detector, swing(100, middle[3]), cues).max() < 1


def test_a_change_in_a_constant_dimension_is_novel():
    detector, cues = trained(*map(swing, range(3)))
    assert (detector.thresholds > 0).all()
    moved = swing(5)
    moved[:, 3] += 1
    score = score_all(detector, moved, cues)[-1]
    assert score.novelty > 1
    assert score.dimension == 3
    assert score.deviation == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("frames", [1, 2, 50])
def test_constant_percepts_give_finite_scores(frames):
    still = np.ones((frames, 2), np.float32)
    detector, cues = trained(still, still)
    assert (detector.thresholds > 0).all()
    assert novelties(detector, still, cues).max() == 0
    score = score_all(detector, still + 1, cues)[0]
    assert 1 < score.novelty < math.inf


def test_without_noise_thresholds_are_still_above_zero():
    detector, cues = trained(*(swing(0, noise=0.0) for _ in range(3)))
    assert novelties(detector, swing(1, noise=0.0), cues).max() < 1


def test_a_single_bad_frame_is_not_novel_but_several_are():
    detector, cues = trained(*map(swing, range(4)))
    percepts = swing(9)
    threshold = detector.thresholds[2]
    percepts[100, 2] += 3 * threshold
    assert novelties(detector, percepts, cues).max() < 1
    percepts[100:105, 2] += 3 * threshold
    assert novelties(detector, percepts, cues).max() > 1


def test_reset_clears_the_smoothed_deviation_only():
    detector, cues = trained(swing(0), swing(1))
    new = swing(5, place=1.0)
    fresh, state = novelties(detector, new, cues), deepcopy(detector.state_dict())
    assert detector.score(new[0], cues).novelty > fresh[0]
    assert np.array_equal(novelties(detector, new, cues), fresh)
    assert all(torch.equal(value, state[name]) for name, value in detector.state_dict().items())


def test_scoring_and_learning_do_not_change_their_arguments():
    detector, cues = trained(swing(0), swing(1))
    percepts = swing(5)
    before = percepts.copy(), cues.copy()
    detector.learn(percepts, cues)
    score_all(detector, percepts, cues)
    assert np.array_equal(percepts, before[0])
    assert np.array_equal(cues, before[1])


def test_in_eval_mode_nothing_is_learned():
    detector, cues = trained(swing(0), swing(1))
    state, other = deepcopy(detector.state_dict()), deepcopy(detector)
    percepts = swing(2, place=1.0)
    assert detector.eval().learn(percepts, cues) == other.learn(percepts, cues) > 1
    assert all(torch.equal(value, state[name]) for name, value in detector.state_dict().items())
    assert len(other.episodes) == 3


def test_it_learns_in_inference_mode_too_and_later_outside_it():
    detector, cues = trained(swing(0), swing(1))
    expected = deepcopy(detector)
    for seed in range(2, 300):  # more than the initial capacity
        expected.learn(swing(seed), cues)
        with torch.inference_mode(seed % 2 == 0):
            detector.learn(swing(seed), cues)
    assert np.array_equal(detector.thresholds, expected.thresholds)


def test_a_loaded_detector_scores_and_learns_alike():
    detector, cues = trained(*map(swing, range(5)))
    loaded, _ = trained(swing(7))
    loaded.load_state_dict(detector.state_dict())
    percepts = swing(9, place=0.3)
    assert np.array_equal(novelties(loaded, percepts, cues), novelties(detector, percepts, cues))
    assert loaded.learn(percepts, cues) == detector.learn(percepts, cues)
    assert np.array_equal(loaded.thresholds, detector.thresholds)


def test_without_training_data_everything_is_novel():
    assert NoveltyDetector(2).score(rows(0, 0), np.empty((0, 2), np.float32)).novelty == math.inf


def test_the_margin_is_what_the_docs_say():
    detector = NoveltyDetector(1)
    detector.learn(rows([0], [1]), None)
    assert detector.thresholds == pytest.approx([MARGIN])
    assert MARGIN == 4


@pytest.mark.parametrize(
    ("percepts", "cues", "message"),
    [
        (np.zeros((0, 2)), None, "expected at least one percept"),
        (np.zeros((3, 4)), None, r"expected percepts as .* \[rows, 2\], got float32 \[3, 4\]"),
        (np.zeros(2), None, "expected percepts as"),
        (np.full((1, 2), np.nan), None, "expected finite percepts"),
        (np.zeros((3, 2)), np.zeros((3, 4)), r"expected cues as .* got float64 \[3, 4\]"),
        (np.zeros((3, 2)), np.full((1, 2), np.inf, "f4"), "expected finite cues"),
    ],
)
def test_bad_episodes_are_refused_before_anything_changes(percepts, cues, message):
    detector = NoveltyDetector(2)
    with pytest.raises(ValueError, match=message):
        detector.learn(percepts.astype(np.float32), cues)
    assert len(detector.episodes) == 0


@pytest.mark.parametrize(
    ("percept", "cues", "message"),
    [
        (rows(0, 0, 0), np.zeros((3, 2)), r"expected a percept as a float32 array \[2\]"),
        (rows([0, 0]), np.zeros((3, 2)), r"expected a percept as a float32 array \[2\]"),
        (rows(0, 0), np.zeros((3, 3)), r"expected cues .* got float32 \[3, 3\]"),
        (rows(0, math.nan), np.zeros((3, 2)), "expected a finite percept"),
    ],
)
def test_bad_percepts_are_refused_before_anything_changes(percept, cues, message):
    detector = NoveltyDetector(2)
    known = rows([0, 0])
    detector.score(rows(1, 1), known)
    other = deepcopy(detector)
    with pytest.raises(ValueError, match=message):
        detector.score(percept, cues.astype(np.float32))
    assert detector.score(rows(1, 1), known) == other.score(rows(1, 1), known)


@pytest.mark.parametrize("dimensions", [0, -1, 2.0, True])
def test_dimensions_are_an_integer_above_zero(dimensions):
    with pytest.raises(ValueError, match="expected dimensions"):
        NoveltyDetector(dimensions)
