"""Learning more: reports, corrections, refusals, interrupts; all of a demonstration or nothing."""

from __future__ import annotations

import pickle
import signal
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from reaching import FPS, FRAMES, NAMES, assert_same, follow, reach, shown

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator
from pacnet.schemas.demonstration_memory import DemonstrationMemory


def test_after_a_correction_the_new_place_and_the_old_one_are_known(trained: Imitator):
    imitator = deepcopy(trained)
    imitator.learn(shown(*(reach(seed, glass=0.15) for seed in (50, 51)), source="corrections"))
    for glass in (0.0, 0.15):
        steps = follow(imitator, reach(100, glass).percepts)
        assert np.mean([step.action is not None for step in steps]) > 0.9
    between = follow(imitator, reach(100, glass=0.075).percepts)[10:]
    assert all(step.is_novel for step in between)


def test_corrections_leave_thresholds_alone_even_if_they_outnumber_the_demonstrations():
    imitator = Imitator.from_demonstrations(shown(reach(0)))
    imitator.learn(shown(reach(0)))
    thresholds = imitator.novelty_detector.thresholds
    for number, glass in enumerate((0.15, 0.3, 0.45)):
        (report,) = imitator.learn(shown(reach(50 + number, glass)), corrections=True)
        assert report.max_novelty > 1
    assert np.array_equal(imitator.novelty_detector.thresholds, thresholds)
    assert torch.equal(imitator.first_action, reach(0).action[0])
    assert [report.correction for report in imitator.reports] == [False, True, True, True]
    assert not any(step.is_novel for step in follow(imitator, reach(100, glass=0.3).percepts))
    assert all(step.is_novel for step in follow(imitator, reach(100, glass=-0.15).percepts)[10:])


def test_reports_say_what_was_learned(demonstrations: Demonstrations):
    imitator = Imitator.from_demonstrations(demonstrations)
    first = imitator.learn(demonstrations)
    later = imitator.learn(shown(reach(7, glass=0.5, task="reach far"), source="later"))
    assert imitator.reports == first + later
    assert [report.episode for report in imitator.reports] == [0, 1, 2, 3, 7]
    assert later[0].dataset == "later"
    assert later[0].task == "reach far"
    assert later[0].frames == FRAMES
    assert first[0].max_novelty is None
    assert later[0].max_novelty > 1
    assert sum(report.new_nodes for report in imitator.reports) == len(imitator.sofm)
    assert later[0].nodes == len(imitator.sofm)
    assert imitator.tasks == ("reach", "reach far")


def test_actions_of_other_tasks_are_no_correction():
    """To the right, and beside that to the left: the place beside the path changes nothing."""

    def along(number: int, y: float, task: str, speed: float) -> Demonstration:
        x = torch.linspace(0, 1, 100)
        state = torch.stack([x, torch.full_like(x, y)], dim=1)
        return Demonstration(number, task, state, torch.empty(100, 0), torch.full((100, 1), speed))

    ways = (("right", 0.0, 1.0), ("right", 0.02, 1.0), ("left", 0.1, -1.0), ("left", 0.12, -1.0))
    episodes = [along(number, y, task, v) for number, (task, y, v) in enumerate(ways)]
    names = {"observation.state": ("x", "y"), "action": ("speed",)}
    both = Demonstrations(FPS, names, tuple(episodes), "both ways")
    imitator = Imitator.from_demonstrations(both)
    imitator.learn(both)
    assert imitator.correction.gain() == pytest.approx(np.zeros((2, 1)), abs=1e-6)
    for task, speed in (("right", 1.0), ("left", -1.0)):
        imitator.reset(task)
        # It is near the demonstrations of both tasks, and far from none.
        assert imitator.step(np.float32([0.5, 0.06])).target == pytest.approx([speed], abs=1e-6)


def test_learning_at_once_equals_learning_one_after_the_other(demonstrations: Demonstrations):
    at_once, piecemeal = (Imitator.from_demonstrations(demonstrations) for _ in range(2))
    at_once.learn(demonstrations)
    for episode in demonstrations:
        piecemeal.learn(shown(episode))
    assert_same(at_once, piecemeal)


def test_the_scale_stays_what_it_was(trained: Imitator):
    imitator = deepcopy(trained)
    before, config = imitator.sofm.scale.clone(), imitator.config
    imitator.learn(shown(replace(reach(9), environment_state=torch.full((FRAMES, 1), 40.0))))
    assert torch.equal(imitator.sofm.scale, before)
    assert imitator.config is config


def test_progress_is_reported_in_frames(demonstrations: Demonstrations):
    frames = []
    Imitator.from_demonstrations(demonstrations).learn(demonstrations, frames.append)
    assert sum(frames) == 4 * FRAMES


def test_the_first_action_is_the_mean_over_the_demonstrations(trained: Imitator):
    assert torch.allclose(trained.first_action, reach(0).action[0])
    imitator = deepcopy(trained)
    other = reach(5)
    imitator.learn(shown(replace(other, action=other.action + 5.0)))
    assert torch.allclose(imitator.first_action, reach(0).action[0] + 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fps": 30}, "expected 50 frames per second, as learned before, got 30"),
        (
            {"names": {**NAMES, "observation.environment_state": ("glass.y",)}},
            "expected 'observation.environment_state' with the dimensions glass.x, as learned "
            "before, got glass.y",
        ),
        ({"names": {**NAMES, "action": ("a", "b")}}, "expected 'action' with the dimensions"),
        ({"names": {k: NAMES[k] for k in ("observation.state", "action")}}, "got none"),
    ],
)
def test_other_demonstrations_are_refused_before_anything_is_learned(
    trained: Imitator, demonstrations: Demonstrations, change: dict, message: str
):
    imitator = deepcopy(trained)
    with pytest.raises(ValueError, match=message):
        imitator.learn(replace(demonstrations, **change))
    assert_same(imitator, trained)


def test_in_eval_mode_nothing_is_learned(trained: Imitator):
    imitator = deepcopy(trained).eval()
    assert imitator.learn(shown(reach(9))) == []
    assert imitator.reports == trained.reports
    assert_same(imitator, trained)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda one: replace(one, state=one.state * torch.nan),
            "episode 8: expected finite state",
        ),
        (lambda one: replace(one, action=one.action / 0), "episode 8: expected finite action"),
        (lambda one: replace(one, action=one.action[:-1]), "got 299 actions, 300 states"),
    ],
)
def test_one_bad_demonstration_refuses_all(trained: Imitator, spoil, message: str):
    imitator = deepcopy(trained)
    with pytest.raises(ValueError, match=message):
        imitator.learn(shown(reach(7), spoil(reach(8))))
    assert imitator.reports == trained.reports
    assert_same(imitator, trained)


def test_an_interrupt_leaves_whole_episodes(trained: Imitator):
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    interrupted, expected = deepcopy(trained), deepcopy(trained)
    with pytest.raises(KeyboardInterrupt):
        interrupted.learn(shown(reach(7), reach(8)), interrupt)
    interrupted.learn(shown(reach(8)))
    expected.learn(shown(reach(7), reach(8)))
    assert interrupted.reports == expected.reports
    assert_same(interrupted, expected)


def test_ctrl_c_waits_until_a_demonstration_is_learned(trained: Imitator, monkeypatch):
    interrupted, expected = deepcopy(trained), deepcopy(trained)
    append = DemonstrationMemory.append

    def interrupted_append(*args: object) -> None:
        signal.raise_signal(signal.SIGINT)
        append(*args)

    monkeypatch.setattr(DemonstrationMemory, "append", interrupted_append)
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in background
    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted.learn(shown(reach(7), reach(8)))
    finally:
        signal.signal(signal.SIGINT, previous)
    monkeypatch.undo()
    expected.learn(shown(reach(7)))
    assert interrupted.reports == expected.reports
    assert_same(interrupted, expected)


def test_an_error_while_a_demonstration_is_learned_leaves_those_before(
    trained: Imitator, monkeypatch
):
    failed, expected = deepcopy(trained), deepcopy(trained)

    def out_of_memory(*_: object) -> None:
        raise MemoryError

    def fail_from_now_on(_: int) -> None:
        monkeypatch.setattr(DemonstrationMemory, "append", out_of_memory)

    with pytest.raises(MemoryError):
        failed.learn(shown(reach(7), reach(8, glass=0.3)), fail_from_now_on)
    monkeypatch.undo()
    expected.learn(shown(reach(7)))
    assert failed.reports == expected.reports
    assert_same(failed, expected)
    for imitator in (failed, expected):
        imitator.learn(shown(reach(9)))
    assert_same(failed, expected)


@pytest.mark.parametrize(
    "copied", [deepcopy, lambda imitator: pickle.loads(pickle.dumps(imitator))],
    ids=["deep copy", "pickle"],
)  # fmt: skip
def test_a_copy_continues_the_recall_episode_and_is_independent(
    trained: Imitator, copied: Callable[[Imitator], Imitator]
):
    imitator, percepts = deepcopy(trained), reach(100).percepts
    follow(imitator, percepts[:100])
    changed, other = copied(imitator), copied(imitator)
    follow(changed, reach(101, glass=0.3).percepts)
    changed.learn(shown(reach(9)))
    expected = [imitator.step(percept) for percept in percepts[100:]]
    np.testing.assert_equal([other.step(percept) for percept in percepts[100:]], expected)
