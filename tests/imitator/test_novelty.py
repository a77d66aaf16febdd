"""The novelty detector: what is novel, in which dimension, and where thresholds come from."""

import math
from copy import deepcopy

import numpy as np
import pytest
import torch

from pacnet.imitator.novelty import PRIOR, SMOOTHING, NoveltyDetector
from pacnet.schemas.demonstration_memory import DemonstrationMemory, Shown

FPS = 10  # at which the deviation is averaged over two frames
ALONE = PRIOR / 2  # threshold where nothing can be compared, in shares of the range


def memory(*paths: object, tasks: tuple[int, ...] = (), corrections: tuple[int, ...] = ()) -> Shown:
    """Demonstrations of these percepts `[T, D]`, or `[T]` of one dimension."""
    kept = None
    for number, path in enumerate(paths):
        rows = np.array(path, np.float32)
        rows = rows[:, None] if rows.ndim == 1 else rows
        kept = kept or DemonstrationMemory(rows.shape[1], 1)
        task = tasks[number] if tasks else 0
        kept.append(rows, np.zeros_like(rows), rows[:, :1], task, number in corrections)
    assert kept is not None
    return kept.shown()


def calibrated(*paths: object, fps: float = FPS, **fields: tuple[int, ...]) -> NoveltyDetector:
    shown = memory(*paths, **fields)
    detector = NoveltyDetector(shown.percepts.shape[1], fps)
    detector.calibrate(shown)
    return detector


def swing(seed: int, frames: int = 200, place: float = 0.0, noise: float = 0.02) -> np.ndarray:
    """An arm that swings out and back beside a glass, and a dimension that never changes."""
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, 2 * np.pi * rng.uniform(0.95, 1.05), frames)
    path = np.stack([np.sin(turn), np.cos(turn), np.full(frames, place)], axis=1)
    noisy = path + noise * rng.standard_normal(path.shape)
    return np.column_stack([noisy, np.full(frames, 0.73)]).astype(np.float32)


def test_scores_match_a_calculation_by_hand():
    detector = NoveltyDetector(2, FPS)
    assert detector.rate == pytest.approx(1 / (SMOOTHING * FPS)) == pytest.approx(0.5)
    detector.thresholds.copy_(torch.tensor([4.0, 8.0]))
    percept, nearest = np.float32([11, 6]), np.float32([10, 10])
    # (1, −4) away: half of that is followed at first, then three quarters.
    assert detector.score(percept, nearest) == pytest.approx((2 / 8, 1, -4, 8))
    assert detector.score(percept, nearest) == pytest.approx((3 / 8, 1, -4, 8))
    detector.reset()
    assert detector.score(percept, nearest) == pytest.approx((2 / 8, 1, -4, 8))


def test_without_training_data_everything_is_novel():
    assert NoveltyDetector(2, FPS).score(np.float32([0, 0]), None).novelty == math.inf


def test_thresholds_of_two_demonstrations_match_a_calculation_by_hand():
    detector = calibrated([0.0, 0.0, 10.0, 10.0], [1.0, 1.0, 13.0, 13.0], fps=5)
    # At 5 frames a second nothing is averaged. Left out, the first is 1, 1, 3 and 3 from the
    # other, and the other from it too: a quantile of 0.9 of 1, 1, 1, 1, 3, 3, 3, 3 is 3. The
    # largest of each is 3, once what is typical. Of so few the threshold is 1.9 times as much,
    # which is above 1.2 / (2 + 1) of the range, 13.
    assert detector.rate == 1
    assert detector.thresholds.tolist() == pytest.approx([1.9 * 3])
    assert int(detector.compared) == 2


def test_thresholds_of_many_demonstrations_match_a_calculation_by_hand():
    # Two for each of eight tasks, which are 1, 2, ..., 8 from one another.
    paths = [[place] for apart in range(1, 9) for place in (0, apart)]
    detector = calibrated(*paths, tasks=tuple(np.arange(16) // 2), fps=5)
    # Deviations are 1, 1, 2, 2, ..., 8, 8: a quantile of 0.9 is 7.5, half-way from the 14th to the
    # 15th. Of 16 there is half of the margin, 0.45, and the quantile of their largest is no less
    # than 0.3: the 5.5th of 1 / 7.5, 1 / 7.5, ..., 8 / 7.5, which is 3 / 7.5.
    assert detector.thresholds.tolist() == pytest.approx([7.5 * 3 / 7.5 * 1.45])


@pytest.mark.parametrize(("count", "share"), [(2, 0.4), (3, 0.3), (11, 0.1)])
def test_thresholds_are_no_less_than_a_share_of_the_range(count: int, share: float):
    same = [0.0, 10.0, 5.0]
    assert calibrated(*[same] * count).thresholds.tolist() == pytest.approx([share * 10])


def test_one_demonstration_gives_a_share_of_its_range():
    path = np.stack([np.linspace(0, 10, 50), np.linspace(5, 3, 50), np.ones(50)], axis=1)
    # Where nothing changes, half of the quadratic mean of 10, 2 and 0 counts as range.
    least = 0.5 * math.sqrt((100 + 4 + 0) / 3)
    expected = ALONE * np.array([10, max(2, least), least])
    assert calibrated(path).thresholds.tolist() == pytest.approx(expected.tolist())


@pytest.mark.parametrize("count", [1, 3])
def test_of_each_task_a_single_demonstration_gives_a_share_of_the_range_of_all(count: int):
    paths = [[0.0, 10.0 + number] for number in range(count)]
    detector = calibrated(*paths, tasks=tuple(range(count)))
    assert detector.thresholds.tolist() == pytest.approx([ALONE * (10 + count - 1)])


def test_only_demonstrations_of_one_task_are_compared():
    paths = [[0.0, 10.0], [3.0, 13.0], [1.0, 11.0]]  # the last one is nearer to both
    detector = calibrated(*paths, tasks=(0, 0, 1), fps=5)
    assert detector.thresholds.tolist() == pytest.approx([1.9 * 3])
    assert calibrated(*paths, fps=5).thresholds.tolist() < detector.thresholds.tolist()


def test_corrections_are_not_compared():
    paths = [swing(0), swing(1), swing(2, place=5.0)]
    without = calibrated(*paths[:2]).thresholds
    assert torch.equal(calibrated(*paths, corrections=(2,)).thresholds, without)
    assert calibrated(*paths).thresholds[2] > 2 * without[2]


def test_thresholds_are_high_where_demonstrations_vary_much():
    places = np.random.default_rng(0).uniform(-1, 1, 8)
    wide = calibrated(*(swing(seed, place=place) for seed, place in enumerate(places)))
    narrow = calibrated(*map(swing, range(8)))
    assert wide.thresholds[2] > 2 * narrow.thresholds[2]


def test_dimensions_keep_their_order():
    order, paths = [3, 1, 0, 2], [swing(seed) for seed in range(4)]
    detector, turned = calibrated(*paths), calibrated(*(path[:, order] for path in paths))
    np.testing.assert_allclose(turned.thresholds, detector.thresholds[order], rtol=1e-5)


def test_the_order_of_demonstrations_does_not_matter():
    paths = [swing(seed) for seed in range(5)]
    one, other = calibrated(*paths), calibrated(*paths[::-1])
    np.testing.assert_allclose(one.thresholds, other.thresholds, rtol=1e-5)


def test_the_novelty_of_an_episode_is_what_scores_one_after_the_other_give():
    shown = memory(*map(swing, range(3)))
    detector, percepts = calibrated(*map(swing, range(3))), swing(9, place=0.3)
    scores = []
    for percept in percepts:  # a second method: the nearest of all rows
        nearest = np.square(shown.percepts - percept).sum(axis=1).argmin()
        scores.append(detector.score(percept, shown.percepts[nearest]).novelty)
    np.testing.assert_allclose(detector.novelty(percepts, shown), scores, rtol=1e-4)
    largest, rows = detector.largest(percepts, shown)
    assert largest == pytest.approx(max(scores), rel=1e-4)
    assert len(rows) == len(percepts)


def test_a_single_bad_frame_is_not_novel_but_several_are():
    paths = [swing(seed) for seed in range(4)]
    detector, shown = calibrated(*paths, fps=50), memory(*paths)
    percepts, threshold = swing(9), detector.thresholds[2].item()
    percepts[100, 2] += 3 * threshold
    assert detector.novelty(percepts, shown).max() < 1
    percepts[100:105, 2] += 3 * threshold
    assert detector.novelty(percepts, shown).max() > 1


def test_lengths_may_differ_by_a_factor_of_a_hundred():
    long, short = swing(0, frames=5000), swing(1, frames=50)
    detector, shown = calibrated(long, short, fps=50), memory(long, short)
    assert (detector.thresholds > 0).all()
    assert detector.novelty(swing(2), shown).max() < 1
    assert detector.novelty(swing(2, place=2.0), shown)[20:].min() > 1


@pytest.mark.parametrize("frames", [1, 2])
def test_demonstrations_of_one_frame_or_two_give_thresholds(frames: int):
    detector = calibrated(np.ones((frames, 2)))
    assert detector.thresholds.tolist() == pytest.approx([ALONE] * 2)  # in the scale's own unit
    several = calibrated(np.ones((1, 2)), np.zeros((1, 2)), swing(0)[:, :2])
    assert (several.thresholds > 0).all()
    assert several.thresholds.isfinite().all()


def test_thresholds_are_taken_anew_once_there_are_a_tenth_more():
    detector = calibrated(*([[0.0, 1.0]] * 20))
    assert not detector.is_due(21)
    assert detector.is_due(22)
    assert NoveltyDetector(1, FPS).is_due(1)


def test_calibrating_and_scoring_change_none_of_their_arguments():
    shown, percepts = memory(swing(0), swing(1)), swing(5)
    before = deepcopy((shown, percepts))
    detector = NoveltyDetector(4, FPS)
    detector.calibrate(shown)
    detector.largest(percepts, shown)
    detector.novelty(percepts, shown)
    detector.score(percepts[0], shown.percepts[0])
    np.testing.assert_equal((shown, percepts), before)


def test_a_loaded_detector_scores_alike():
    detector, loaded = calibrated(*map(swing, range(3))), NoveltyDetector(4, FPS)
    loaded.load_state_dict(detector.state_dict())
    one, nearest = swing(9)[0], swing(1)[0]
    assert loaded.score(one, nearest) == detector.score(one, nearest)
    assert not loaded.is_due(3)


@pytest.mark.parametrize("dimensions", [0, -1, 2.0, True])
def test_dimensions_are_an_integer_above_zero(dimensions: object):
    with pytest.raises(ValueError, match="expected dimensions"):
        NoveltyDetector(dimensions, FPS)
