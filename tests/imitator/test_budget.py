"""Bounded memory: nodes share it out, and an imitator acts on what is kept."""

from copy import deepcopy

import numpy as np
import pytest
import torch
from reaching import FRAMES, assert_same, follow, reach, shown

from pacnet.imitator import Imitator
from pacnet.imitator.budget import kept_rows, shares
from pacnet.schemas.demonstration_memory import DemonstrationMemory

BUDGET = 3 * FRAMES // 5  # a fifth of three demonstrations


def with_budget(count: int, budget: int = BUDGET) -> Imitator:
    demonstrations = shown(*map(reach, range(count)))
    imitator = Imitator.from_demonstrations(demonstrations, budget=budget)
    imitator.learn(demonstrations)
    return imitator


@pytest.mark.parametrize(
    ("counts", "budget", "expected"),
    [
        ([10, 10], 6, [3, 3]),
        ([1, 10, 10], 9, [1, 4, 4]),  # what the first leaves is shared by the others
        ([2, 3, 100], 60, [2, 3, 55]),
        ([10, 1, 10, 2], 10, [4, 1, 3, 2]),  # 7 are left for two
        ([0, 5, 0], 3, [0, 3, 0]),
        ([4, 5], 100, [4, 5]),
        ([3, 3, 3], 2, [1, 1, 0]),
        ([5, 1, 9], 2, [1, 1, 0]),  # too few for all: the rarest are kept
    ],
)
def test_the_budget_is_shared_out_as_water_fills(counts, budget, expected):
    assert shares(np.array(counts), budget).tolist() == expected


def test_shares_are_never_more_than_the_budget_nor_than_there_are():
    rng = np.random.default_rng(0)
    for _ in range(200):
        counts, budget = rng.integers(0, 30, rng.integers(1, 9)), int(rng.integers(1, 100))
        share = shares(counts, budget)
        assert share.sum() == min(budget, counts.sum())
        assert (share <= counts).all()
        full = share == counts  # those that are not all kept keep as many as any other, but for one
        assert full.all() or share[~full].min() >= share.max() - 1


def test_of_each_situation_rows_are_kept_evenly():
    situation, one = np.array([0] * 10 + [1] * 2), np.zeros(12, np.int64)
    # Situation 1 keeps both, 0 the rows in the middle of five equal parts: 1, 3, 5, 7, 9.
    assert kept_rows(situation, one, 7).nonzero()[0].tolist() == [1, 3, 5, 7, 9, 10, 11]
    assert kept_rows(situation, one, 12).all()
    # Of each demonstration in a situation equally many: 1 of its 2 rows, 2 of its 8.
    of = np.array([0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1])
    assert kept_rows(one, of, 4).nonzero()[0].tolist() == [0, 1, 4, 9]


def test_no_demonstration_is_forgotten_for_later_ones():
    imitator = with_budget(20, 400)
    rows = imitator.memory.demonstrations.live("rows")
    assert int(rows.min()) >= 10
    assert int(rows.max()) <= 40
    assert (
        with_budget(20, 400).memory.rows.live("percept").equal(imitator.memory.rows.live("percept"))
    )


def test_a_task_keeps_its_part_beside_one_that_is_shown_more_often():
    rare = shown(*(reach(number, task="rare") for number in range(3)))
    often = shown(*(reach(number, task="often") for number in range(50, 62)))
    imitator = Imitator.from_demonstrations(rare, budget=200)
    imitator.learn(rare)
    imitator.learn(often)
    rows = imitator.memory.demonstrations.live("rows")
    assert int(rows[:3].sum()) == pytest.approx(100, abs=25)
    imitator.reset("rare")
    assert imitator.step(reach(100).percepts[0]).action is not None


def test_within_a_fifth_it_still_acts_at_every_frame():
    imitator, new = with_budget(3), reach(100)
    assert len(imitator.memory.rows) == BUDGET
    steps = follow(imitator, new.percepts)
    assert not any(step.action is None for step in steps)
    wrong = [
        np.abs(step.action - action).max()
        for step, action in zip(steps, new.action.numpy(), strict=True)
    ]
    assert np.median(wrong) < 0.1
    assert max(wrong) < 0.4


@pytest.mark.parametrize("budget", [1, 7, 450, 10_000])
def test_no_more_is_kept_than_the_budget_however_much_is_shown(budget: int):
    imitator = Imitator.from_demonstrations(shown(reach(0)), budget=budget)
    for number in range(5):
        imitator.learn(shown(reach(number, glass=0.01 * number)))
        assert len(imitator.memory.rows) == min(budget, (number + 1) * FRAMES)
        assert len(imitator.memory) == len(imitator.reports) == number + 1
        step = imitator.step(reach(number).percepts[0])
        assert all(one.demonstration <= number for one in step.followed)
    assert step.followed


def test_a_demonstration_of_which_nothing_is_kept_is_no_obstacle(tmp_path):
    imitator = with_budget(3, budget=2)
    assert min(np.diff(imitator.memory.shown().first)) == 0
    imitator.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    assert_same(loaded, imitator)
    percepts = reach(100).percepts
    np.testing.assert_equal(follow(loaded, percepts), follow(imitator, percepts))
    for one in (imitator, loaded):
        one.learn(shown(reach(7)))
    assert_same(loaded, imitator)
    assert imitator.recognise(percepts).progress.isfinite().all()


def test_what_fails_while_something_is_forgotten_changes_nothing(monkeypatch):
    failed = with_budget(3)
    expected = deepcopy(failed)
    follow(failed, reach(100).percepts[:100])
    select = DemonstrationMemory.select

    def forget_and_fail(*given: object) -> None:
        select(*given)
        raise MemoryError

    monkeypatch.setattr(DemonstrationMemory, "select", forget_and_fail)
    with pytest.raises(MemoryError):
        failed.learn(shown(reach(7)))
    monkeypatch.undo()
    assert_same(failed, expected)
    assert failed.reports == expected.reports
    follow(expected, reach(100).percepts[:100])
    percept = reach(100).percepts[100]
    np.testing.assert_equal(failed.step(percept), expected.step(percept))


def test_after_something_was_forgotten_an_episode_begins_anew():
    imitator = with_budget(3)
    percepts = reach(100).percepts
    follow(imitator, percepts[:150])
    imitator.learn(shown(reach(7)))
    other = deepcopy(imitator)
    other.reset()
    imitator.novelty_detector.reset()
    np.testing.assert_equal(imitator.step(percepts[150]), other.step(percepts[150]))


@pytest.mark.parametrize("budget", [0, -1, 2.0, True, "9"])
def test_a_budget_is_a_positive_integer_or_none(budget: object):
    with pytest.raises(ValueError, match=r"expected ImitatorConfig\.budget ≥ 1, or None"):
        Imitator.from_demonstrations(shown(reach(0)), budget=budget)


def test_without_a_budget_every_frame_is_kept():
    imitator = Imitator.from_demonstrations(shown(reach(0)))
    imitator.learn(shown(*map(reach, range(4))))
    assert len(imitator.memory.rows) == 4 * FRAMES
    scaled = torch.cat([reach(seed).percepts for seed in range(4)]).numpy()
    np.testing.assert_array_equal(
        imitator.memory.shown().percepts, scaled * imitator.config.scaling.array
    )
