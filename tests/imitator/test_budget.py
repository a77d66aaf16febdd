"""Bounded memory: keyframes are kept, and an imitator acts on what is between them."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from reaching import FRAMES, assert_same, follow, reach, shown

from pacnet.datasets.demonstrations import Demonstration
from pacnet.imitator import Imitator
from pacnet.imitator.budget import ENOUGH, importances, kept_rows
from pacnet.schemas.demonstration_memory import DemonstrationMemory, Shown

BUDGET = 3 * FRAMES // 20  # a twentieth of three demonstrations


def with_budget(count: int, budget: int | None = BUDGET) -> Imitator:
    demonstrations = shown(*map(reach, range(count)))
    imitator = Imitator.from_demonstrations(demonstrations, budget=budget)
    imitator.learn(demonstrations)
    return imitator


def rows_of(imitator: Imitator) -> list[int]:
    """Number of rows that are kept of each demonstration."""
    return imitator.memory.demonstrations.live("rows").tolist()


def errors(imitator: Imitator, new: Demonstration, first: int = 0) -> np.ndarray:
    """How far its actions are from those shown, from a frame on, `[T]`; it acts at each."""
    steps = follow(imitator, new.percepts)[first:]
    actions = new.action.numpy()[first:]
    return np.array(
        [np.abs(step.action - action).max() for step, action in zip(steps, actions, strict=True)]
    )


def lines(*places: float, tasks: str) -> Shown:
    """Keyframes of demonstrations that all go from a place to 1 higher, in 20 frames."""
    memory = DemonstrationMemory(1, 1)
    for place, task in zip(places, tasks, strict=True):
        rows = np.linspace(place, place + 1, 20, dtype=np.float32)[:, None]
        memory.append(rows, rows, rows, "ab".index(task), correction=False)
    return memory.shown()


def kept_of(shown: Shown, budget: int, parts: list[int] | None = None) -> list[int]:
    """Number of rows of each demonstration that are kept; all rows are equally important."""
    count = len(shown.frames)
    numbers = np.array(parts) if parts else np.arange(count)
    rows = kept_rows(shown, np.ones(len(shown.percepts)), numbers, budget)
    assert len(rows) <= budget
    assert (np.diff(rows) > 0).all()
    return np.histogram(rows, shown.first)[0].tolist()


@pytest.mark.parametrize(
    ("places", "tasks", "budget", "expected"),
    [
        ([0, 5, 0], "aaa", 60, [20, 20, 20]),
        ([0, 5, 0], "aaa", 50, [0, 20, 20]),  # the first is shown again by the third
        ([0, 5, 0], "aba", 50, [0, 20, 20]),
        ([0, 5, 0.1], "aab", 50, [0, 20, 20]),  # the older of two of the task with more of them
        ([0, 5, 0], "abb", 50, [20, 0, 20]),
        ([0, 0, 0, 0], "aaaa", 45, [0, 0, 20, 20]),  # of alike ones the later ones stay
        ([0, 5, 5.1, 5.2, 9], "aaaaa", 60, [20, 0, 0, 20, 20]),  # what is shown only once stays
        ([0, 5, 9, 0, 5, 9], "aaabbb", 80, [20, 0, 20, 20, 0, 20]),  # each task keeps as many
        ([0, 5], "ab", 39, [20, 19]),  # no task is forgotten, with however few frames
        ([0, 5, 0], "aab", 30, [0, 20, 10]),
        ([0, 5], "aa", 3, [0, 3]),
    ],
)
def test_what_later_ones_of_its_task_show_again_goes(places, tasks: str, budget: int, expected):
    assert kept_of(lines(*places, tasks=tasks), budget) == expected


def test_the_parts_of_an_episode_stay_or_go_together():
    three = lines(0, 5, 0, 5, 9, tasks="aaaaa")
    assert min(kept_of(three, 100, [1, 1, 2, 2, 3])) == 20
    assert kept_of(three, 59, [1, 1, 2, 2, 3]) == [0, 0, 20, 20, 19]
    # Fifteen parts have 30 ends: beside 20 frames of another there is no room for them.
    many = lines(*[0] * 15, 9, tasks="a" * 16)
    assert kept_of(many, 49, [1] * 15 + [2]) == [0] * 15 + [20]
    assert sum(kept_of(many, 50, [1] * 15 + [2])[:15]) > 0


def test_the_most_important_rows_of_all_are_kept():
    shown = lines(0, 5, tasks="ab")
    rng = np.random.default_rng(0)
    important = rng.permutation(40).astype(float)
    kept = kept_rows(shown, important, np.arange(2), 40)
    assert kept.tolist() == [*range(40)]
    alone = kept_rows(lines(0, tasks="a"), important[:20], np.arange(1), 7)
    assert alone.tolist() == np.sort(np.argsort(important[:20])[-7:]).tolist()
    # Of the last one importance is as it was measured, of the others among their own keyframes.
    again = importances(shown, important[20:])
    assert again[20:].tolist() == important[20:].tolist()
    assert np.isinf(again[[0, 19]]).all()
    assert again[1:19].max() < 1e-6  # a line


@pytest.mark.parametrize("budget", [1, 2, 7, 45, 450, 10_000])
def test_no_more_is_kept_than_the_budget_however_much_is_shown(budget: int, tmp_path: Path):
    imitator = Imitator.from_demonstrations(shown(reach(0)), budget=budget)
    for number in range(5):
        imitator.learn(shown(reach(number, glass=0.01 * number)))
        assert 0 < len(imitator.memory.rows) <= min(budget, (number + 1) * FRAMES)
        assert len(imitator.memory) == len(imitator.reports) == number + 1
        assert rows_of(imitator)[-1] > 0
        step = imitator.step(reach(number).percepts[0])
        assert step.followed
        assert all(rows_of(imitator)[one.demonstration] for one in step.followed)
    assert imitator.recognise(reach(9).percepts[:30]).progress.isfinite().all()
    # Saved in between it goes on like the one that was not.
    imitator.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    assert_same(loaded, imitator)
    for one in (imitator, loaded, imitator.fork()):
        one.learn(shown(reach(7)))
        assert_same(one, imitator)
    percepts = reach(100).percepts[::10]
    np.testing.assert_equal(follow(loaded, percepts), follow(imitator, percepts))


def test_enough_of_each_demonstration_is_kept_or_nothing():
    imitator = with_budget(20, 400)
    assert rows_of(imitator)[-1] > 0
    assert all(rows == 0 or rows >= 10 for rows in rows_of(imitator))
    assert_same(with_budget(20, 400), imitator)  # the same demonstrations, the same bytes


def test_all_tasks_keep_equally_many_demonstrations():
    rare = shown(*(reach(number, task="rare") for number in range(3)))
    often = shown(*(reach(number, task="often") for number in range(50, 62)))
    imitator = Imitator.from_demonstrations(rare, budget=4 * ENOUGH)
    imitator.learn(rare)
    imitator.learn(often)
    assert sum(rows > 0 for rows in rows_of(imitator)[:3]) == 2
    assert sum(rows > 0 for rows in rows_of(imitator)[3:]) == 2
    imitator.reset("rare")
    assert imitator.step(reach(100).percepts[0]).action is not None


def test_within_a_twentieth_it_acts_as_with_all_frames():
    few, all_frames, new = with_budget(3), with_budget(3, None), reach(100)
    assert len(few.memory.rows) <= BUDGET
    one, other = errors(few, new), errors(all_frames, new)
    assert one.mean() < other.mean() + 0.01
    assert one.max() < other.max() + 0.05
    # The least that could be done with so few: the nearest of as many frames, evenly chosen.
    every = 3 * FRAMES // BUDGET
    rows = torch.cat([reach(seed).percepts for seed in range(3)])[::every]
    actions = torch.cat([reach(seed).action for seed in range(3)])[::every]
    nearest = torch.cdist(new.percepts, rows).argmin(dim=1)
    assert one.mean() < (actions[nearest] - new.action).abs().amax(dim=1).mean().item() / 2


def rested(one: Demonstration, frames: int) -> Demonstration:
    """The same after so many frames at its first place, of noise alone."""
    noise = 0.01 * torch.randn(frames, 2, generator=torch.Generator().manual_seed(frames))
    rest = one.action[-1] + noise, one.environment_state[:1].repeat(frames, 1)
    return replace(
        one,
        state=torch.cat([rest[0], one.state]),
        environment_state=torch.cat([rest[1], one.environment_state]),
        action=torch.cat([one.action[-1:].repeat(frames, 1), one.action]),
    )


def test_a_minute_of_rest_before_each_demonstration_does_not_matter():
    minute = 3_000  # frames
    few, new = with_budget(3), reach(100)
    demonstrations = shown(*(rested(reach(seed), minute + seed) for seed in range(3)))
    late = Imitator.from_demonstrations(demonstrations, budget=BUDGET)
    late.learn(demonstrations)
    assert len(late.memory.rows) <= BUDGET
    assert late.memory.whole().frames.max() < 1.3 * FRAMES
    assert errors(late, new).mean() < errors(few, new).mean() + 0.02
    followed = [step.followed[0].frame for step in follow(late, new.percepts)[100:]]
    assert min(followed) > minute  # as it was shown


def test_what_is_followed_is_told_as_it_was_shown():
    few, all_frames, percepts = with_budget(3), with_budget(3, None), reach(100).percepts
    pairs = zip(follow(few, percepts), follow(all_frames, percepts), strict=True)
    apart = [one.followed[0].frame - other.followed[0].frame for one, other in pairs]
    assert np.abs(apart).mean() < FRAMES / 20


def test_a_demonstration_of_one_frame_and_one_that_never_changes():
    imitator = with_budget(2, 200)
    still = reach(5).part(10, 11)
    constant = replace(
        still,
        state=still.state.repeat(50, 1),
        environment_state=still.environment_state.repeat(50, 1),
        action=still.action.repeat(50, 1),
    )
    imitator.learn(shown(still, constant))
    assert rows_of(imitator)[2:] == [1, 2]
    assert imitator.memory.whole().frames[2:].tolist() == [1, 2]
    assert imitator.step(reach(100).percepts[0]).action is not None


def test_values_as_large_as_are_allowed_are_kept_within_bounds(tmp_path: Path):
    """Least squares alone would go beyond them."""
    imitator, one = with_budget(2), reach(3)
    step = torch.where(torch.arange(FRAMES) < FRAMES // 2, -1.0, 1.0)[:, None]
    largest = 0.99e17 / torch.tensor(imitator.config.scaling.scale)
    huge = replace(
        one,
        state=step * largest[:2],
        environment_state=step * largest[2:],
        action=(step * 0.99e17).repeat(1, 2),
    )
    imitator.learn(shown(huge))
    imitator.save_pretrained(tmp_path)
    assert_same(Imitator.from_pretrained(tmp_path), imitator)


def test_what_fails_while_something_is_forgotten_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
):
    failed = with_budget(3)
    expected = deepcopy(failed)
    follow(failed, reach(100).percepts[:100])
    select = DemonstrationMemory.select

    def forget_and_fail(*given: Any) -> None:
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


def test_what_was_taken_before_something_is_forgotten_stays():
    imitator = with_budget(3)
    fork, taken = imitator.fork(), imitator.memory.shown()
    state = fork.state_dict()
    percepts = taken.percepts.copy()
    imitator.learn(shown(reach(7), reach(8)))
    assert len(imitator.memory) == 5
    np.testing.assert_array_equal(taken.percepts, percepts)
    torch.testing.assert_close(fork.state_dict(), state, rtol=0, atol=0)


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
def test_a_budget_is_a_positive_integer_or_none(budget: Any):
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
