"""A recall episode: it goes on over a lesson, and a step costs few calls."""

import inspect
import sys
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
import torch
from reaching import FRAMES, follow, reach, shown

import pacnet
from pacnet.datasets.demonstrations import Demonstration
from pacnet.imitator import Imitator

_PACNET = str(Path(inspect.getfile(pacnet)).parent)


def calm(seed: int) -> Demonstration:
    """A reach beside a glass that stands still."""
    return replace(reach(seed), environment_state=torch.zeros(FRAMES, 1))


@pytest.fixture(scope="module")
def calmed() -> Imitator:
    demonstrations = shown(*map(calm, range(3)))
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return imitator


def test_an_episode_goes_on_over_a_lesson(calmed: Imitator):
    imitator, percepts = deepcopy(calmed), calm(100).percepts
    before = follow(imitator, percepts[:150])[-1]
    imitator.learn(shown(calm(7)))
    step = imitator.step(percepts[150])
    known = {one.demonstration: one.frame for one in before.followed}
    assert {one.demonstration for one in step.followed} == {*known, 3}  # the new one too
    for one in step.followed:  # the others are not begun again
        assert one.frame == pytest.approx(known.get(one.demonstration, 149) + 1, abs=4)
    assert step.action == pytest.approx(calm(100).action[150].numpy(), abs=0.05)


@pytest.mark.parametrize("copied", [False, True])
def test_an_episode_begins_anew_once_another_state_is_loaded(calmed: Imitator, copied: bool):
    imitator, percepts = deepcopy(calmed), calm(100).percepts
    follow(imitator, percepts[:150])
    imitator = deepcopy(imitator) if copied else imitator
    other = Imitator(calmed.config)
    other.learn(shown(calm(9).part(0, 20)))  # of fewer rows
    imitator.load_state_dict(other.state_dict())
    imitator.reports = other.reports
    for percept in percepts[:3]:
        np.testing.assert_equal(imitator.step(percept)[-2:], other.step(percept)[-2:])


def test_steps_are_the_same_after_a_reset(trained: Imitator):
    imitator, percepts = deepcopy(trained), reach(100).percepts[:50]
    np.testing.assert_equal(follow(imitator, percepts), follow(imitator, percepts))


def test_progress_goes_from_0_to_1_and_says_when_it_is_done(calmed: Imitator):
    steps = follow(deepcopy(calmed), calm(100).percepts)
    progress = np.array([step.progress for step in steps])
    np.testing.assert_allclose(progress, np.arange(FRAMES) / (FRAMES - 1), atol=0.05)
    assert steps[-1].is_done
    assert not any(step.is_done for step in steps[: FRAMES - 10])
    assert all(sum(one.weight for one in step.followed) == pytest.approx(1) for step in steps)


def test_a_step_changes_neither_the_percept_nor_what_is_known(trained: Imitator):
    imitator, percept = deepcopy(trained), reach(100).percepts[0].numpy()
    state, given = deepcopy(imitator.state_dict()), percept.copy()
    step = imitator.step(percept)
    assert step.action is not None
    step.action[:] = 9  # nor does what the caller does with the answer
    assert np.array_equal(percept, given)
    assert all(tensor.equal(state[name]) for name, tensor in imitator.state_dict().items())


def test_a_step_goes_from_file_to_file_few_times(trained: Imitator):
    """Each way into another file of the package or back counts; a reader follows all of them."""
    imitator, percept = deepcopy(trained), reach(100).percepts[0].numpy()
    imitator.warm_up()
    imitator.step(percept)
    crossings = 0

    def count(frame: FrameType, event: str, _: object) -> None:
        nonlocal crossings
        caller = frame.f_back
        names = [one.f_code.co_filename for one in (frame, caller) if one is not None]
        inside = len(names) == 2 and all(name.startswith(_PACNET) for name in names)
        crossings += event in ("call", "return") and inside and names[0] != names[1]

    sys.setprofile(count)
    try:
        imitator.step(percept)
    finally:
        sys.setprofile(None)
    assert 0 < crossings <= 20
