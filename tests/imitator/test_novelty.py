"""Claims about familiarity: what is new, where, and what demonstrations teach of it."""

import math
from copy import deepcopy

import numpy as np
import pytest
import torch

from pacnet.imitator.novelty import MARGIN, RATE, Familiarity

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


def taught(*episodes):
    """What has learned these episodes, and all their percepts as cues."""
    familiarity = Familiarity(episodes[0].shape[1])
    cues = episodes[0][:0]
    for episode in episodes:
        familiarity.learn(episode, cues)
        cues = np.concatenate([cues, episode])
    return familiarity, cues


def judge_all(familiarity, percepts, cues):
    familiarity.reset()
    return [familiarity.judge(percept, cues) for percept in percepts]


def novelties(familiarity, percepts, cues):
    return np.array([judgement.novelty for judgement in judge_all(familiarity, percepts, cues)])


def test_a_judgement_worked_out_by_hand():
    familiarity = Familiarity(2)
    # Both dimensions change from frame to frame by as much each time: 1 and 2.
    assert math.isnan(familiarity.learn(rows([0, 0], [1, 2], [2, 4]), None))
    assert familiarity.tolerance == pytest.approx([4, 8])
    cues = rows([0, 0], [10, 10])
    # The second cue is nearer, (1, −4) away; a tenth of that is followed, then 0.19 of it.
    first, second = judge_all(familiarity, rows([11, 6], [11, 6]), cues)
    assert first == pytest.approx((0.4 / 8, 1, -4, 8))
    assert second == pytest.approx((0.76 / 8, 1, -4, 8))


def test_a_lesson_worked_out_by_hand():
    familiarity, known = Familiarity(1), rows([0], [1], [2])
    familiarity.learn(known, None)  # 1 from frame to frame
    # 8 from the nearest, then 4 on the other side: 0.8, then 0.9 · 0.8 + 0.1 · 4 = 1.12.
    assert familiarity.learn(rows([10], [-4]), known) == pytest.approx(1.12 / 4)
    assert familiarity.usual == pytest.approx([1])  # the lower median of 1 and 1.12
    familiarity.learn(rows([2], [8]), known)  # 0, then 0.1 · 6 = 0.6
    assert familiarity.usual == pytest.approx([1])  # the median of 1, 1.12 and 0.6
    familiarity.learn(rows([2], [1]), known)  # 0
    assert familiarity.usual == pytest.approx([0.6])  # the lower median of 0, 0.6, 1 and 1.12
    familiarity.learn(rows([50]), known)  # one frame shows nothing
    assert familiarity.usual == pytest.approx([0.6])
    for _ in range(2):
        familiarity.learn(rows([2], [1]), known)  # of 0, 0, 0, 0.6, 1 and 1.12 it is 0
    assert familiarity.usual == pytest.approx([0.25])  # a quarter of what the first one moved by


def test_what_one_demonstration_teaches_worked_out_by_hand():
    steps = np.where(np.arange(100) % 20 == 0, 3.0, 1.0)  # five of a hundred are of 3
    path = np.concatenate([[0], np.cumsum(steps)])
    familiarity = Familiarity(2)
    familiarity.learn(np.stack([path, np.full(101, 7)], axis=1).astype(np.float32), None)
    # Where nothing changed, a tenth of the quadratic mean of 3 and 0 is usual.
    assert familiarity.usual == pytest.approx([3, 0.1 * 3 / math.sqrt(2)])


def test_novelty_is_over_what_was_usual_before_the_episode():
    familiarity, cues = taught(swing(0))
    before, percepts = familiarity.tolerance, swing(1)
    expected = novelties(familiarity, percepts, cues).max()
    assert familiarity.learn(percepts, cues) == pytest.approx(expected, rel=1e-5)
    assert (familiarity.tolerance != before).any()


def test_the_nearest_is_found_far_from_the_origin_too():
    rng = np.random.default_rng(0)
    cues = (1e4 + rng.standard_normal((300, 3))).astype(np.float32)
    percepts = (1e4 + rng.standard_normal((50, 3))).astype(np.float32)
    familiarity = Familiarity(3)
    familiarity.learn(percepts, None)
    tolerance = familiarity.tolerance.copy()
    followed, largest = np.zeros(3), np.zeros(3)
    for percept in percepts.astype(np.float64):  # a second method: one by one, in float64
        apart = percept - cues
        followed += RATE * (abs(apart[(apart**2).sum(axis=1).argmin()]) - followed)
        largest = np.maximum(largest, followed)
    assert familiarity.learn(percepts, cues) == pytest.approx((largest / tolerance).max(), rel=1e-3)


def test_more_of_the_same_is_known_and_another_place_is_new_and_named():
    familiarity, cues = taught(*map(swing, range(8)))
    for seed in range(100, 110):
        assert novelties(familiarity, swing(seed), cues).max() < 0.8
    judgements = judge_all(familiarity, swing(100, place=1.0), cues)[10:]
    assert all(one.novelty > 1 and one.dimension == 2 for one in judgements)
    assert np.mean([one.deviation for one in judgements]) == pytest.approx(1, abs=0.1)


def test_one_demonstration_is_enough_to_begin_with():
    familiarity, cues = taught(swing(0))
    assert novelties(familiarity, swing(0), cues).max() == 0
    for seed in range(100, 105):
        assert novelties(familiarity, swing(seed), cues).max() < 1
    assert novelties(familiarity, swing(100, place=1.0), cues)[10:].min() > 1


def test_dimensions_keep_their_order():
    order = [3, 1, 0, 2]
    familiarity, cues = taught(*map(swing, range(4)))
    turned, turned_cues = taught(*(swing(seed)[:, order] for seed in range(4)))
    assert turned.tolerance == pytest.approx(familiarity.tolerance[order])
    percepts = swing(9, place=0.5)
    for one, other in zip(
        judge_all(familiarity, percepts, cues),
        judge_all(turned, percepts[:, order], turned_cues),
        strict=True,
    ):
        assert other.novelty == pytest.approx(one.novelty, rel=1e-4)
        assert order[other.dimension] == one.dimension


def test_a_correction_does_not_widen_what_is_tolerated():
    familiarity, cues = taught(*map(swing, range(8)))
    before, known = familiarity.tolerance, novelties(familiarity, swing(100), cues)
    for seed, place in enumerate((1.0, -1.0, 2.0)):
        percepts = swing(50 + seed, place=place)
        assert familiarity.learn(percepts, cues) > 1
        cues = np.concatenate([cues, percepts])
    assert (familiarity.tolerance < 1.5 * before).all()
    assert novelties(familiarity, swing(100), cues) == pytest.approx(known, abs=0.2)
    assert novelties(familiarity, swing(101, place=0.5), cues)[10:].min() > 1
    assert novelties(familiarity, swing(101, place=1.0), cues).max() < 1  # known by now


def test_the_very_first_correction_does_not_either():
    familiarity, cues = taught(swing(0))
    before = familiarity.tolerance
    familiarity.learn(swing(1, place=5.0), cues)
    assert (familiarity.tolerance <= before + 1e-6).all()


@pytest.mark.parametrize("count", [1, 2, 4])
def test_what_is_said_to_be_a_correction_never_does_however_many_there_are(count):
    familiarity, cues = taught(*map(swing, range(count)))
    before = familiarity.tolerance
    for seed in range(2 * count):
        percepts = swing(50 + seed, place=1.0 + seed)
        assert familiarity.learn(percepts, cues, correction=True) > 1
        cues = np.concatenate([cues, percepts])
    assert np.array_equal(familiarity.tolerance, before)
    assert novelties(familiarity, swing(101, place=-1.0), cues)[10:].min() > 1


def test_the_first_episode_tells_what_is_usual_whatever_it_is_said_to_be():
    one, other = Familiarity(4), Familiarity(4)
    one.learn(swing(0), None)
    other.learn(swing(0), None, correction=True)
    assert np.array_equal(one.tolerance, other.tolerance)


def test_where_demonstrations_mostly_vary_much_much_is_tolerated():
    places = np.random.default_rng(0).uniform(-1, 1, 8)
    familiarity, cues = taught(*(swing(i, place) for i, place in enumerate(places)))
    narrow, _ = taught(*map(swing, range(8)))
    assert familiarity.tolerance[2] > 2 * narrow.tolerance[2]
    middle = (np.sort(places)[1:] + np.sort(places)[:-1]) / 2
    assert novelties(familiarity, swing(100, middle[3]), cues).max() < 1


def test_a_dimension_that_never_changed_is_new_as_soon_as_it_does():
    familiarity, cues = taught(*map(swing, range(3)))
    assert (familiarity.tolerance > 0).all()
    moved = swing(5)
    moved[:, 3] += 1
    judgement = judge_all(familiarity, moved, cues)[-1]
    assert judgement.novelty > 1
    assert judgement.dimension == 3
    assert judgement.deviation == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("frames", [1, 2, 50])
def test_percepts_that_never_change_give_numbers(frames):
    still = np.ones((frames, 2), np.float32)
    familiarity, cues = taught(still, still)
    assert (familiarity.tolerance > 0).all()
    assert novelties(familiarity, still, cues).max() == 0
    judgement = judge_all(familiarity, still + 1, cues)[0]
    assert 1 < judgement.novelty < math.inf


def test_without_noise_there_is_a_tolerance_still():
    familiarity, cues = taught(*(swing(0, noise=0.0) for _ in range(3)))
    assert novelties(familiarity, swing(1, noise=0.0), cues).max() < 1


def test_a_single_bad_frame_is_not_new_but_several_are():
    familiarity, cues = taught(*map(swing, range(4)))
    percepts = swing(9)
    tolerated = familiarity.tolerance[2]
    percepts[100, 2] += 3 * tolerated
    assert novelties(familiarity, percepts, cues).max() < 1
    percepts[100:105, 2] += 3 * tolerated
    assert novelties(familiarity, percepts, cues).max() > 1


def test_reset_forgets_what_was_judged_and_nothing_else():
    familiarity, cues = taught(swing(0), swing(1))
    new = swing(5, place=1.0)
    fresh, state = novelties(familiarity, new, cues), deepcopy(familiarity.state_dict())
    assert familiarity.judge(new[0], cues).novelty > fresh[0]
    assert np.array_equal(novelties(familiarity, new, cues), fresh)
    assert all(torch.equal(value, state[name]) for name, value in familiarity.state_dict().items())


def test_judging_and_learning_leave_their_arguments_alone():
    familiarity, cues = taught(swing(0), swing(1))
    percepts = swing(5)
    before = percepts.copy(), cues.copy()
    familiarity.learn(percepts, cues)
    judge_all(familiarity, percepts, cues)
    assert np.array_equal(percepts, before[0])
    assert np.array_equal(cues, before[1])


def test_in_eval_mode_nothing_is_learned():
    familiarity, cues = taught(swing(0), swing(1))
    state, other = deepcopy(familiarity.state_dict()), deepcopy(familiarity)
    percepts = swing(2, place=1.0)
    assert familiarity.eval().learn(percepts, cues) == other.learn(percepts, cues) > 1
    assert all(torch.equal(value, state[name]) for name, value in familiarity.state_dict().items())
    assert len(other.episodes) == 3


def test_it_learns_in_inference_mode_too_and_later_outside_it():
    familiarity, cues = taught(swing(0), swing(1))
    expected = deepcopy(familiarity)
    for seed in range(2, 300):  # more than there was room for
        expected.learn(swing(seed), cues)
        with torch.inference_mode(seed % 2 == 0):
            familiarity.learn(swing(seed), cues)
    assert np.array_equal(familiarity.tolerance, expected.tolerance)


def test_a_saved_one_judges_and_learns_alike():
    familiarity, cues = taught(*map(swing, range(5)))
    loaded, _ = taught(swing(7))
    loaded.load_state_dict(familiarity.state_dict())
    percepts = swing(9, place=0.3)
    assert np.array_equal(novelties(loaded, percepts, cues), novelties(familiarity, percepts, cues))
    assert loaded.learn(percepts, cues) == familiarity.learn(percepts, cues)
    assert np.array_equal(loaded.tolerance, familiarity.tolerance)


def test_what_has_learned_nothing_knows_nothing():
    assert Familiarity(2).judge(rows(0, 0), np.empty((0, 2), np.float32)).novelty == math.inf


def test_the_margin_is_what_the_docs_say():
    familiarity = Familiarity(1)
    familiarity.learn(rows([0], [1]), None)
    assert familiarity.tolerance == pytest.approx([MARGIN])
    assert MARGIN == 4


@pytest.mark.parametrize(
    ("percepts", "cues", "message"),
    [
        (np.zeros((0, 2)), None, "expected percepts of shape"),
        (np.zeros((3, 4)), None, r"expected percepts of shape .* got \[3, 4\]"),
        (np.zeros(2), None, "expected percepts of shape"),
        (np.full((1, 2), np.nan), None, "expected finite percepts"),
        (np.zeros((3, 2)), np.zeros((3, 4)), r"expected cues of shape .* got \[3, 4\]"),
        (np.zeros((3, 2)), np.full((1, 2), np.inf), "expected finite cues"),
    ],
)
def test_bad_lessons_are_refused_before_anything_changes(percepts, cues, message):
    familiarity = Familiarity(2)
    with pytest.raises(ValueError, match=message):
        familiarity.learn(percepts.astype(np.float32), cues)
    assert len(familiarity.episodes) == 0


@pytest.mark.parametrize(
    ("percept", "cues", "message"),
    [
        (rows(0, 0, 0), np.zeros((3, 2)), r"expected a percept \[2\]"),
        (rows([0, 0]), np.zeros((3, 2)), r"expected a percept \[2\]"),
        (rows(0, 0), np.zeros((3, 3)), r"got \[2\] and \[3, 3\]"),
        (rows(0, math.nan), np.zeros((3, 2)), "expected a finite percept"),
    ],
)
def test_bad_percepts_are_refused_before_anything_changes(percept, cues, message):
    familiarity = Familiarity(2)
    known = rows([0, 0])
    familiarity.judge(rows(1, 1), known)
    other = deepcopy(familiarity)
    with pytest.raises(ValueError, match=message):
        familiarity.judge(percept, cues.astype(np.float32))
    assert familiarity.judge(rows(1, 1), known) == other.judge(rows(1, 1), known)


@pytest.mark.parametrize("dimensions", [0, -1, 2.0, True])
def test_dimensions_are_an_integer_above_zero(dimensions):
    with pytest.raises(ValueError, match="expected dimensions"):
        Familiarity(dimensions)
