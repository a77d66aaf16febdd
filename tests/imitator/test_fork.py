"""Imitators that share what is known: several robots, or a thread that acts beside one that learns.

Each has a recall episode of its own, and what one learns is not the other's.
"""

from __future__ import annotations

import threading
import tracemalloc
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from reaching import assert_same, reach, shown

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator, ImitatorStep


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    return shown(*(reach(seed) for seed in range(4)))


@pytest.fixture
def trained(demonstrations: Demonstrations) -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return imitator


def acted(steps: list[ImitatorStep]) -> list[list[float] | None]:
    return [None if step.action is None else step.action.tolist() for step in steps]


def steps_of(imitator: Imitator, episode: Demonstration, frames: slice) -> list[ImitatorStep]:
    return [imitator.step(percept) for percept in episode.percepts[frames]]


def test_a_fork_begins_an_episode_and_leaves_that_of_the_original(trained: Imitator):
    new, whole, half = reach(100), slice(0, 80), slice(0, 40)
    trained.reset()
    alone = acted(steps_of(trained, new, whole))
    trained.reset(task=trained.tasks[0])
    began = acted(steps_of(trained, new, half))
    fork = trained.fork()
    assert acted(steps_of(fork, new, whole)) == alone
    assert began + acted(steps_of(trained, new, slice(40, 80))) == alone


def test_its_novelty_begins_anew(trained: Imitator):
    scale = trained.config.scaling.array
    far = trained.memory.shown().percepts[0] / scale
    far[2] += 3 * trained.novelty_detector.thresholds.numpy()[2] / scale[2]  # of the glass
    trained.reset()
    first = trained.step(far).novelty
    assert [trained.step(far).novelty for _ in range(12)][-1] > first  # smoothed over steps
    assert trained.fork().step(far).novelty == first


def test_what_either_learns_is_not_the_others(trained: Imitator):
    lessons = [shown(reach(20 + number, glass=0.15 * number)) for number in range(3)]
    fork, again = trained.fork(), trained.fork()
    expected = []
    for lesson in lessons:
        alone = Imitator.from_demonstrations(shown(*(reach(seed) for seed in range(4))))
        alone.learn(shown(*(reach(seed) for seed in range(4))))
        alone.learn(lesson)
        expected.append(alone)
    for imitator, lesson in zip((trained, fork, again), lessons, strict=True):
        imitator.learn(lesson)
    for imitator, alone in zip((trained, fork, again), expected, strict=True):
        assert_same(imitator, alone)
        imitator.reset()
        alone.reset()
        new = reach(100)
        whole = slice(None)
        assert acted(steps_of(imitator, new, whole)) == acted(steps_of(alone, new, whole))


def test_an_episode_of_a_fork_goes_on_while_the_original_learns(trained: Imitator):
    new, fork, undisturbed = reach(100), trained.fork(), trained.fork()
    for imitator in (fork, undisturbed):
        steps_of(imitator, new, slice(0, 40))
    for number in range(30):  # which also fills the memory that they share
        trained.learn(shown(reach(20 + number)))
    rest = slice(40, None)
    assert acted(steps_of(fork, new, rest)) == acted(steps_of(undisturbed, new, rest))
    assert len(fork.reports) == 4


def test_a_fork_takes_little_memory():
    """A robot of a batch costs kilobytes, not all that was shown."""
    stream = torch.randn(200_000, 30, generator=torch.Generator().manual_seed(0)).cumsum(dim=0)
    names = {
        "observation.state": tuple(f"s{number}" for number in range(30)),
        "action": tuple(f"a{number}" for number in range(10)),
    }
    one = Demonstration(0, "walk", stream, stream[:, :0], stream[:, :10].contiguous())
    walk = Demonstrations(50, names, (one,), "walk")
    part = replace(walk, episodes=(replace(one, state=stream[:500], action=one.action[:500],
                                           environment_state=stream[:500, :0]),))  # fmt: skip
    imitator = Imitator.from_demonstrations(part)
    memory = imitator.memory
    percepts = stream.numpy()
    memory.append(percepts, percepts, percepts[:, :10].copy(), 0, False)
    assert memory.rows.percept.nbytes == 24_000_000
    forked = _allocated(imitator.fork)
    assert forked < 1_000_000
    pointers = [_addresses(each) for each in (imitator, imitator.fork())]
    assert pointers[0] == pointers[1]


def _allocated(call: Callable[[], object]) -> int:
    """Bytes that numpy and Python allocate; those of torch are compared by address."""
    tracemalloc.start()
    kept = call()
    size = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert kept is not None
    return size


def _addresses(imitator: Imitator) -> list[int]:
    known = imitator.memory.shown()
    buffers = [buffer.data_ptr() for buffer in imitator.memory.buffers()]
    return [*buffers, *(array.ctypes.data for array in known)]


@pytest.mark.parametrize("budget", [None, 500])
def test_learning_beside_it_does_not_begin_an_episode_anew(budget: int | None):
    """A thread that acts goes on where it is, unless frames that it follows are dropped."""
    first = shown(*(reach(seed) for seed in range(4)))
    imitator = Imitator.from_demonstrations(first, budget=budget)
    imitator.learn(first)
    imitator.warm_up()
    percept, done, failures, followers = reach(100).percepts[50], threading.Event(), [], []

    def act() -> None:
        try:
            while not done.is_set():
                imitator.step(percept)
                if imitator.follower not in followers:
                    followers.append(imitator.follower)
        except Exception as failure:
            failures.append(failure)

    acting = threading.Thread(target=act)
    acting.start()
    for seed in range(10, 25):
        imitator.learn(shown(reach(seed)))
    done.set()
    acting.join()
    assert failures == []
    assert budget is not None or len(followers) == 1


def test_a_budget_leaves_what_another_thread_reads(trained: Imitator):
    before = trained.memory.fork()
    rows = before.demonstrations.live("rows").tolist()
    trained.memory.select(np.arange(len(trained.memory.rows)) % 2 == 0)
    assert before.demonstrations.live("rows").tolist() == rows
    assert sum(trained.memory.demonstrations.live("rows").tolist()) == len(trained.memory.rows)


def test_a_demonstration_of_which_nothing_is_kept_keeps_its_place(trained: Imitator):
    memory, first = trained.memory, trained.memory.shown().first
    rows = np.ones(first[-1], bool)
    rows[first[1] : first[2]] = rows[first[3] :] = False
    memory.select(rows)
    assert memory.demonstrations.live("rows").tolist() == [300, 0, 300, 0]
    memory.select(np.arange(600) % 3 == 0)
    assert memory.demonstrations.live("rows").tolist() == [100, 0, 100, 0]


def test_what_is_loaded_into_a_fork_stays_out_of_what_it_is_a_fork_of(trained: Imitator):
    expected, other = deepcopy(trained), trained.fork()
    more = trained.fork()
    more.learn(shown(reach(7)))
    other.load_state_dict(more.state_dict())
    assert_same(trained, expected)
    assert_same(other, more)
    assert_same(trained.fork(), expected)
