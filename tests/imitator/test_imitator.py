"""The imitator: settings from the data, names, reports, learning more, not acting when novel."""

from __future__ import annotations

import json
import math
import pickle
import signal
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from reaching import FPS, FRAMES, NAMES, assert_same, follow, reach, shown

from pacnet import CompetingSchemas
from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import EpisodeReport, Imitator
from pacnet.schemas.targets import targets_ahead


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    return shown(*(reach(seed) for seed in range(4)))


@pytest.fixture(scope="module")
def trained(demonstrations: Demonstrations) -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return imitator


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
    assert sum(report.new_nodes for report in imitator.reports) == len(imitator.network.sofm)
    assert later[0].nodes == len(imitator.network.sofm)
    assert imitator.network.behaviours == ("reach", "reach far")


def test_learning_at_once_equals_learning_one_after_the_other(demonstrations: Demonstrations):
    at_once, piecemeal = (Imitator.from_demonstrations(demonstrations) for _ in range(2))
    at_once.learn(demonstrations)
    for episode in demonstrations:
        piecemeal.learn(shown(episode))
    assert_same(at_once, piecemeal)


def test_the_scale_stays_what_it_was(trained: Imitator):
    imitator = deepcopy(trained)
    before = imitator.network.sofm.scale.clone()
    imitator.learn(shown(replace(reach(9), environment_state=torch.full((FRAMES, 1), 40.0))))
    assert torch.equal(imitator.network.sofm.scale, before)


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


def test_warming_up_changes_no_step(trained: Imitator):
    warm, cold = deepcopy(trained), deepcopy(trained)
    percepts = reach(100).percepts
    follow(warm, percepts[:30])
    warm.warm_up()
    cold.reset()
    assert warm.network.schemas._timeline is not None
    for percept in percepts[:30]:
        one, other = warm.step(percept), cold.step(percept)
        assert one.novelty == other.novelty
        assert np.array_equal(one.action, other.action)


def test_a_loaded_imitator_acts_and_learns_like_the_saved_one(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path / "checkpoint")
    loaded = Imitator.from_pretrained(tmp_path / "checkpoint")
    assert loaded.reports == trained.reports
    assert isinstance(loaded.reports[0], EpisodeReport)
    assert loaded.config == trained.config
    percepts = torch.cat([reach(100).percepts[:150], reach(101, glass=0.2).percepts[:20]])
    for ours, theirs in zip(follow(trained, percepts), follow(loaded, percepts), strict=True):
        assert (ours.action is None) == (theirs.action is None)
        assert ours.action is None or np.array_equal(ours.action, theirs.action)
        assert (ours.novelty, ours.dimension) == (theirs.novelty, theirs.dimension)
    for imitator in (trained := deepcopy(trained), loaded):
        imitator.learn(shown(reach(6, glass=0.3)))
    assert_same(trained, loaded)


def test_other_checkpoints_are_refused(trained: Imitator, tmp_path: Path):
    trained.network.save_pretrained(tmp_path)
    with pytest.raises(ValueError, match="expected a checkpoint of Imitator"):
        Imitator.from_pretrained(tmp_path)


def test_a_checkpoint_with_a_field_too_many_is_refused(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, {**fields, "speed": 3}, tensors)
    with pytest.raises(ValueError, match=r"expected the fields of ImitatorConfig.*speed"):
        Imitator.from_pretrained(tmp_path)


def test_a_checkpoint_without_a_tensor_is_refused(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    del tensors["first_action"]
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match=r"expected the tensors of an Imitator.*first_action"):
        Imitator.from_pretrained(tmp_path)


def test_a_checkpoint_of_version_0_1_loads_under_the_new_names(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    lessons = fields.pop("reports")
    for lesson in lessons:
        lesson["unfamiliar"] = lesson.pop("max_novelty")
    old = {}
    for name, tensor in tensors.items():
        name = name.replace("novelty_detector", "familiarity")
        old[name.replace("typical_deviation", "usual")] = tensor
    assert {"familiarity.usual", "familiarity.episodes.deviation"} < old.keys()
    write_checkpoint(tmp_path, {**fields, "lessons": lessons}, old)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.reports == trained.reports
    assert_same(loaded, trained)
    percepts = reach(100, glass=0.1).percepts[:30]
    np.testing.assert_equal(follow(loaded, percepts), follow(trained, percepts))
    loaded.load_state_dict(old)
    assert_same(loaded, trained)


def test_old_names_still_work_with_a_warning(trained: Imitator):
    step, report = follow(trained, reach(100).percepts[:1])[0], trained.reports[1]
    old_names = {
        "lessons": (trained, trained.reports),
        "familiarity": (trained, trained.novelty_detector),
        "usual": (trained.novelty_detector, trained.novelty_detector.typical_deviation),
        "tolerated": (step, step.threshold),
        "unfamiliar": (report, report.max_novelty),
    }
    for name, (owner, value) in old_names.items():
        with pytest.deprecated_call(match=f"{name} is now"):
            assert getattr(owner, name) is value


def test_the_config_is_json(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())["config"]
    assert config["percepts"]["observation.state"] == ["shoulder", "elbow"]
    assert config["network"]["schemas"]["type"] == "competing_schemas"


def test_a_checkpoint_that_does_not_name_the_kind_of_schemas_loads(
    trained: Imitator, tmp_path: Path
):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    del fields["network"]["schemas"]["type"]
    write_checkpoint(tmp_path, fields, tensors)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.config == trained.config
    assert_same(loaded, trained)


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
    state = one.state[::every]
    ahead = targets_ahead(state, steps=5)  # the commanded position, farther away than the noise
    one = replace(one, state=state, environment_state=one.environment_state[::every], action=ahead)
    demonstrations = Demonstrations(fps, NAMES, (one,), "reaching")
    imitator = Imitator.from_demonstrations(demonstrations)
    (report,) = imitator.learn(demonstrations)
    assert int(imitator.network.schemas.lengths.sum()) > 0.95 * report.frames
    at, way = one.state[0], []
    for _ in range(2 * report.frames):
        step = imitator.step(torch.cat([at, torch.zeros(1)]))
        at = at if step.action is None else torch.from_numpy(step.action)
        way.append(at)
    hops = pairwise(way)  # five frames at a time: a place may lie between two
    way = torch.cat(
        [torch.lerp(here, there, torch.arange(10)[:, None] / 10) for here, there in hops]
    )
    for part in (0.25, 0.5, 0.75):  # of the demonstration: the arm comes by there
        there = one.state[int(part * report.frames)]
        assert float((way - there).norm(dim=1).amin()) < 0.05


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
    append_rows = CompetingSchemas.append_rows

    def interrupted_append(*args: object) -> None:
        signal.raise_signal(signal.SIGINT)
        append_rows(*args)

    monkeypatch.setattr(CompetingSchemas, "append_rows", interrupted_append)
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
        monkeypatch.setattr(CompetingSchemas, "append_rows", out_of_memory)

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


@pytest.mark.parametrize("deviation", [math.nan, -1.0, 0.0])
def test_a_checkpoint_without_positive_typical_deviations_is_refused(
    trained: Imitator, deviation: float, tmp_path: Path
):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    tensors["novelty_detector.typical_deviation"][0] = deviation
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match="typical_deviation"):
        Imitator.from_pretrained(tmp_path)


@pytest.mark.parametrize("reports", [None, "all", [{"dataset": "reaching"}], [], [3]])
def test_a_checkpoint_with_other_reports_is_refused(
    trained: Imitator, reports: object, tmp_path: Path
):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, {**fields, "reports": reports}, tensors)
    with pytest.raises(ValueError, match="report"):
        Imitator.from_pretrained(tmp_path)


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
        at[fps] = Imitator.from_demonstrations(episodes).config.network.attention.winner_tau
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
    candidates = torch.tensor(imitator.config.forward_model.candidates)
    assert torch.allclose(candidates, torch.tensor([[-0.02], [0.02]]))
    place = 1.0
    for _ in range(100):
        action = imitator.step(np.float32([place])).action
        place += 0.0 if action is None else float(action[0])
    assert place == pytest.approx(3.0, abs=0.2)


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
