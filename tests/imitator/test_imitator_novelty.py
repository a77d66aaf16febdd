"""What an imitator calls novel: a moved object, a dimension that never changed; and until when."""

import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from reaching import FPS, FRAMES, NAMES, follow, reach, shown

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator


def learned(*episodes: Demonstration, fps: float = FPS) -> Imitator:
    demonstrations = Demonstrations(fps, NAMES, episodes, "reaching")
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return imitator


def sampled(fps: int, seed: int) -> Demonstration:
    """An arm that turns, with a reach and a place by the seed, the same at any rate."""
    rng = np.random.default_rng(seed)
    size, place = 1 + 0.1 * rng.standard_normal(2), 0.05 * rng.standard_normal(2)
    time = np.arange(6 * fps) / fps  # [s]
    path = np.stack([size[0] * np.sin(time), size[1] * np.cos(time)], axis=1) + place
    state = torch.from_numpy(path).float()
    return Demonstration(seed, "turn", state, torch.full((len(state), 1), 0.1 * seed), state)


@pytest.mark.parametrize("count", [1, 6])
def test_thresholds_are_the_same_at_any_frame_rate(count: int):
    thresholds = []
    for fps in (20, 50, 200):
        imitator = learned(*(sampled(fps, seed) for seed in range(count)), fps=fps)
        scaled = imitator.novelty_detector.thresholds.numpy()
        thresholds.append(scaled / imitator.config.scaling.array)  # in each dimension's unit
    np.testing.assert_allclose(thresholds, [thresholds[1]] * 3, rtol=0.2)


@pytest.mark.parametrize("count", [1, 4])
def test_a_moved_object_is_held_before_and_acted_on_again_once_it_is_back(count: int):
    imitator, new = learned(*map(reach, range(count))), reach(100).percepts.clone()
    moved = slice(100, 200)
    new[moved, 2] += 0.15
    steps = follow(imitator, new)
    assert not any(step.is_novel for step in steps[:100])
    assert all(step.action is None and step.dimension == "glass.x" for step in steps[105:200])
    settled = 200 + round(1.0 * FPS)  # the deviation fades within a second
    assert not any(step.action is None for step in steps[settled:])


@pytest.mark.parametrize("count", [1, 4])
def test_a_dimension_that_was_constant_and_moves_later_is_novel_and_is_named(count: int):
    constant = torch.full((FRAMES, 1), 0.7)
    episodes = [replace(reach(seed), environment_state=constant) for seed in range(count)]
    imitator = learned(*episodes)
    usual = follow(imitator, replace(reach(100), environment_state=constant).percepts)
    assert not any(step.is_novel for step in usual)
    for moved in (1.7, -0.3):
        one = replace(reach(100), environment_state=torch.full((FRAMES, 1), moved))
        steps = follow(imitator, one.percepts)[FPS:]
        assert all(step.is_novel and step.dimension == "glass.x" for step in steps)
        assert steps[0].deviation == pytest.approx(moved - 0.7, abs=1e-4)


def test_deviation_and_threshold_are_in_the_dimensions_own_unit():
    imitator = learned(*map(reach, range(4)))
    step = follow(imitator, reach(100, glass=0.15).percepts[:50])[-1]
    assert step.dimension == "glass.x"
    assert step.deviation == pytest.approx(0.15, abs=0.03)
    scale = imitator.config.scaling.scale[2]
    assert step.threshold == pytest.approx(float(imitator.novelty_detector.thresholds[2]) / scale)


def test_a_frame_that_was_learned_is_not_novel_even_alone():
    imitator = Imitator.from_demonstrations(shown(reach(0)))
    imitator.learn(shown(reach(0).part(7, 8)))
    assert imitator.reports[0].frames == 1
    step = imitator.step(reach(0).percepts[7])
    assert not step.is_novel
    assert step.action == pytest.approx(reach(0).action[7].numpy(), abs=1e-5)
    assert (step.is_done, step.progress) == (True, 1.0)
    imitator.reset()
    steps = [imitator.step(reach(0).percepts[7] + torch.tensor([9.0, 0, 0])) for _ in range(30)]
    assert steps[-1].is_novel


def test_demonstrations_may_be_of_very_different_lengths():
    imitator = learned(reach(0), reach(1).part(100, 103), reach(2))
    steps = follow(imitator, reach(100).percepts)
    assert not any(step.is_novel for step in steps)
    assert all(step.is_novel for step in follow(imitator, reach(100, glass=0.5).percepts)[FPS:])


def test_recognition_calls_the_same_percepts_novel():
    imitator = learned(*map(reach, range(3)))
    percepts = torch.cat([reach(100).percepts[:100], reach(100, glass=0.15).percepts[100:]])
    recognition = imitator.recognise(percepts)
    steps = follow(imitator, percepts)
    np.testing.assert_allclose(recognition.novelty, [step.novelty for step in steps], rtol=1e-3)
    assert recognition.is_novel.tolist() == [step.is_novel for step in steps]


def test_recognition_leaves_an_episode_as_it_is():
    imitator = learned(*map(reach, range(3)))
    percepts = reach(100).percepts
    follow(imitator, percepts[:100])
    other = deepcopy(imitator)
    imitator.recognise(percepts)
    np.testing.assert_equal(imitator.step(percepts[100]), other.step(percepts[100]))


def test_recognition_tells_tasks_apart_and_how_far_they_are():
    away = [replace(reach(seed, task="away"), state=-reach(seed).state) for seed in range(2)]
    imitator = learned(*map(reach, range(2)), *away)
    for task, one in enumerate((reach(100), replace(reach(100), state=-reach(100).state))):
        recognition = imitator.recognise(one.percepts)
        assert (recognition.behaviour[FPS:] == task).all()
        torch.testing.assert_close(recognition.probability.sum(dim=1), torch.ones(FRAMES))
        middle = float(recognition.progress[FRAMES // 2])
        assert middle == pytest.approx(0.5, abs=0.1)
        end = recognition.end_percept[FRAMES // 2, :2]
        torch.testing.assert_close(end, one.state[-1], rtol=0, atol=0.1)


def test_nothing_is_recognised_before_anything_was_learned():
    with pytest.raises(ValueError, match="expected an imitator that has learned something"):
        Imitator.from_demonstrations(shown(reach(0))).recognise(reach(0).percepts)
    for bad in (torch.zeros(3, 2), torch.full((3, 3), math.nan), torch.zeros(3)):
        with pytest.raises(ValueError, match="expected"):
            learned(reach(0)).recognise(bad)
