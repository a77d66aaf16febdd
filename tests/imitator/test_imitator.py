"""The imitator: settings from the data, names, not acting when novel, targets that are states."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from reaching import FPS, FRAMES, NAMES, follow, reach, shown

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator
from pacnet.schemas.targets import targets_ahead


def test_it_repeats_the_demonstrated_actions(trained: Imitator):
    new = reach(100)
    steps = follow(trained, new.percepts)
    assert not any(step.is_novel for step in steps)
    acted = [number for number, step in enumerate(steps) if step.action is not None]
    assert len(acted) > 0.95 * FRAMES
    wrong = [np.abs(steps[number].action - new.action[number].numpy()).max() for number in acted]
    assert np.median(wrong) < 0.05
    assert max(wrong) < 0.2


def test_a_novel_percept_gets_no_action_and_the_step_names_the_dimension(trained: Imitator):
    steps = follow(trained, reach(100, glass=0.15).percepts)[10:]
    assert all(step.action is None and step.is_novel for step in steps)
    assert {step.dimension for step in steps} == {"glass.x"}
    assert all(step.novelty > 1 for step in steps)


def test_warming_up_changes_no_step(trained: Imitator):
    warm, cold = deepcopy(trained), deepcopy(trained)
    percepts = reach(100).percepts
    follow(warm, percepts[:30])
    warm.warm_up()
    cold.reset()
    for percept in percepts[:30]:
        one, other = warm.step(percept), cold.step(percept)
        assert one.novelty == other.novelty
        assert np.array_equal(one.action, other.action)


def test_old_names_still_work_with_a_warning(trained: Imitator):
    step, report = follow(trained, reach(100).percepts[:1])[0], trained.reports[1]
    old_names = {
        "lessons": (trained, trained.reports),
        "familiarity": (trained, trained.novelty_detector),
        "tolerated": (step, step.threshold),
        "unfamiliar": (report, report.max_novelty),
    }
    for name, (owner, value) in old_names.items():
        with pytest.deprecated_call(match=f"{name} is now"):
            assert getattr(owner, name) is value


@pytest.mark.parametrize(
    "percept", [np.zeros(2, "f4"), np.full(3, np.nan, "f4"), np.zeros(3), torch.zeros(1, 3)]
)
def test_other_percepts_are_refused(trained: Imitator, percept: object):
    imitator = deepcopy(trained)
    imitator.reset()
    with pytest.raises(ValueError, match="percept"):
        imitator.step(percept)


def test_before_anything_was_learned_nothing_is_done(demonstrations: Demonstrations):
    step = Imitator.from_demonstrations(demonstrations).step(demonstrations.episodes[0].percepts[0])
    assert step.action is None
    assert step.is_novel


@pytest.mark.parametrize(("fps", "frames"), [(30, 80), (50, 300)])
def test_one_demonstration_is_enough_to_act_by(fps: int, frames: int):
    one, every = reach(0), FRAMES // frames
    state = one.state[::every][:frames]
    ahead = targets_ahead(state, steps=5)  # the commanded position, farther away than the noise
    one = replace(one, state=state, environment_state=torch.zeros(frames, 1), action=ahead)
    demonstrations = Demonstrations(fps, NAMES, (one,), "reaching")
    imitator = Imitator.from_demonstrations(demonstrations)
    (report,) = imitator.learn(demonstrations)
    assert len(imitator.memory.rows) == report.frames
    at, way = one.state[0], []
    for _ in range(2 * report.frames):
        action = imitator.step(torch.cat([at, torch.zeros(1)])).action
        assert action is not None
        at = at + (torch.from_numpy(action) - at) / 5  # as far as it is ahead
        way.append(at)
    apart = torch.cdist(one.state, torch.stack(way)).amin(dim=1)
    assert float(apart[5:].amax()) < 0.06  # the arm comes by everywhere


@pytest.mark.parametrize("lead", [0, FRAMES, 2.0])
def test_a_lead_within_the_demonstrations(demonstrations: Demonstrations, lead: int):
    with pytest.raises(ValueError, match="expected lead as a number of frames from 1 to 299"):
        Imitator.from_demonstrations(demonstrations, targets="state", lead=lead)


def test_percepts_and_actions_of_one_feature_are_refused(demonstrations: Demonstrations):
    names = {"observation.state": NAMES["observation.state"]}
    same = replace(demonstrations, names=names, action="observation.state")
    with pytest.raises(
        ValueError, match=r"of different features, got 'observation.state' for both"
    ):
        Imitator.from_demonstrations(same)


def test_habituation_takes_the_same_time_at_any_frame_rate():
    at = {}
    for fps in (10, 50):
        episodes = Demonstrations(fps, NAMES, (reach(0),), "reaching")
        at[fps] = Imitator.from_demonstrations(episodes).config.attention.winner_tau
    assert at == {10: 1.0, 50: 5.0}


def pushed() -> Demonstration:
    """A point on a line that is pushed by ±0.02 a frame: to and fro at first, then to 6."""
    actions = torch.tensor(5 * (10 * [0.02] + 10 * [-0.02]) + 300 * [0.02])
    state = torch.cat([torch.zeros(1), actions.cumsum(0)[:-1]])
    return Demonstration(0, "go", state[:, None], torch.empty(400, 0), actions[:, None])


def test_states_as_targets_are_reached_through_a_forward_model():
    names = {"observation.state": ("place",), "action": ("push",)}
    demonstrations = Demonstrations(FPS, names, (pushed(), pushed()), "going")
    imitator = Imitator.from_demonstrations(demonstrations, targets="state", lead=5)
    imitator.learn(demonstrations)
    place = 3.0  # far behind the part to and fro, so that it begins in the middle
    for _ in range(100):
        step = imitator.step(np.float32([place]))
        assert step.target.shape == (1,)
        place += 0.0 if step.action is None else float(step.action[0])
    assert place == pytest.approx(5.0, abs=0.2)


def test_states_as_targets_need_actions_that_differ(demonstrations: Demonstrations):
    still = [replace(one, action=torch.zeros_like(one.action)) for one in demonstrations]
    with pytest.raises(ValueError, match="expected actions that differ"):
        Imitator.from_demonstrations(shown(*still), targets="state")


def test_the_old_constructor_warns_and_returns_the_same(
    demonstrations: Demonstrations, trained: Imitator
):
    with pytest.warns(DeprecationWarning, match="untaught is now Imitator.from_demonstrations"):
        imitator = Imitator.untaught(demonstrations, targets="action")
    assert imitator.config == trained.config
    assert imitator.reports == []
