"""What happens on the way in frames of reference, and what several demonstrations are for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
import torch
from picking import Scene, World, act, demonstrate, scene, shown, somewhere, taught
from reaching import assert_same
from torch import Tensor

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.imitator import Imitator

PLAIN = World()


@pytest.fixture(scope="module")
def learned() -> Imitator:
    """Of one demonstration; tests begin an episode of their own and teach only a fork."""
    return taught(PLAIN)


def steps_of(imitator: Imitator, now: Scene, frames: int = 150) -> list[np.ndarray]:
    """The actions of an episode that goes on, one after the other."""
    actions = []
    for _ in range(frames):
        action = imitator.step(now.percept).action
        assert action is not None
        actions.append(action)
        now.move(action)
    return actions


@pytest.mark.parametrize("frame", [5, 20, 30])
def test_an_object_that_is_moved_on_the_way_is_followed(learned: Imitator, frame: int):
    def push(number: int, now: Scene) -> None:
        if number == frame:
            now.thing = now.thing + np.array([0.15, -0.1])

    assert act(learned, scene(PLAIN), meanwhile=push)


@pytest.mark.parametrize("shift", [(0.1, 0.2), (-0.1, -0.1), (0.04, 0.0)])
def test_a_goal_that_is_moved_on_the_way_is_followed(learned: Imitator, shift):
    """It never moved in the demonstration."""

    def move(number: int, now: Scene) -> None:
        if number == 80:
            now.goal = now.goal + shift

    now = scene(PLAIN)
    assert act(learned, now, meanwhile=move)
    assert np.linalg.norm(now.thing - now.goal) < 0.03
    np.testing.assert_allclose(now.goal, np.array([-0.3, 0.3]) + shift)


def test_a_landmark_that_is_perceived_with_noise_is_smoothed_and_yet_followed():
    """Of the goal, noise of 5 mm is left that a mean over 20 frames and more leaves."""
    random = np.random.default_rng(0)
    one = demonstrate(scene(PLAIN))
    noise = torch.from_numpy(random.normal(0, 0.005, one.environment_state.shape)).float()
    imitator = taught(PLAIN, replace(one, environment_state=one.environment_state + noise))
    frames = imitator.config.frames
    assert frames is not None
    assert 0 < frames.smoothing[2][0] < 0.2
    now, places = scene(PLAIN), []
    for frame in range(300):
        if frame == 100:
            now.goal = now.goal + np.array([0.1, 0.2])
        percept = now.percept
        percept[3:] += random.normal(0, 0.005, 4)
        action = imitator.step(percept).action
        assert action is not None
        if frame == 95:
            places.append(imitator._framed_follower.state.places[2, :2].copy())
        now.move(action)
    assert np.linalg.norm(places[0] - [-0.3, 0.3]) < 0.004
    assert now.is_done


def test_an_object_that_is_lost_is_picked_up_again(learned: Imitator):
    """It jumps out of the hand half way, about 0.3 m away."""
    segments, lost = [], []

    def lose(number: int, now: Scene) -> None:
        if now.held is not None and now.hand[0] < 0 and not lost:
            now.held, now.thing = None, now.thing + np.array([0.25, -0.15])
            lost.append(number)
        segments.append(learned._framed_follower.state.segment.item())

    now = scene(PLAIN)
    assert act(learned, now, frames=350, meanwhile=lose)
    assert lost
    goes = segments[lost[0] - 2 :]  # segments as of the step before
    changes = [segment for segment, _ in groupby(goes)]
    assert changes == [1, 0, 1]


def test_where_the_hand_begins_does_not_matter(learned: Imitator):
    for start in ((0.4, -0.3), (-0.5, 0.0), (0.0, 0.5)):
        now = scene(PLAIN)
        now.hand = np.array(start)
        assert act(learned, now)


def test_a_demonstration_that_contradicts_two_others_has_no_say():
    """It goes to the goal only, and begins at its very first scene; the others begin elsewhere."""
    odd = demonstrate(scene(PLAIN, (0.2, 0.4), (-0.4, -0.1)), 2, carry=False)
    usual = [demonstrate(scene(PLAIN), 0), demonstrate(scene(PLAIN, (0.4, -0.2), (-0.2, 0.4)), 1)]
    there = scene(PLAIN, (0.2, 0.4), (-0.4, -0.1))
    imitator = taught(PLAIN, *usual, odd)
    imitator.reset()
    assert imitator.step(there.percept).followed[0].demonstration != 2
    assert act(imitator, there)
    fewer = taught(PLAIN, usual[0], odd)  # of two none is more usual than the other
    assert fewer.step(scene(PLAIN, (0.2, 0.4), (-0.4, -0.1)).percept).followed[0].demonstration == 1


def test_the_demonstration_of_the_most_similar_scene_is_followed():
    right = demonstrate(scene(PLAIN, (0.4, 0.1)), 0)
    left = demonstrate(scene(PLAIN, (-0.4, 0.0), (0.3, 0.4)), 1)
    imitator = taught(PLAIN, right, left)
    for number, place, goal in ((0, (0.35, 0.05), (-0.3, 0.3)), (1, (-0.3, 0.0), (0.3, 0.3))):
        imitator.reset()
        step = imitator.step(scene(PLAIN, place, goal).percept)
        assert step.followed[0].demonstration == number


def test_of_several_tasks_the_one_that_is_asked_for_is_done():
    pick = demonstrate(scene(PLAIN), 0, "pick")
    visit = demonstrate(scene(PLAIN, (0.3, 0.2)), 1, "visit", carry=False)
    imitator = taught(PLAIN, pick, visit)
    for task, number, carried in (("pick", 0, True), ("visit", 1, False)):
        now = scene(PLAIN)
        imitator.reset(task)
        for _ in range(200):
            step = imitator.step(now.percept)
            assert step.action is not None
            assert [one.demonstration for one in step.followed] == [number]
            now.move(step.action)
        assert now.is_done == carried
        assert (np.linalg.norm(now.hand - now.goal) < 0.1) or carried


def test_a_second_call_of_learn_adds_demonstrations_and_an_episode_goes_on(learned: Imitator):
    """The forward model stays the one of the first demonstrations."""
    imitator, untouched = learned.fork(), learned.fork()
    now, same = somewhere(PLAIN, 2), somewhere(PLAIN, 2)
    steps_of(imitator, now, 30)
    steps_of(untouched, same, 30)
    model = imitator.frames.forward_model.gain.clone()
    imitator.learn(shown(PLAIN, demonstrate(scene(PLAIN, (-0.2, 0.3), (0.4, 0.2)), 1)))
    assert torch.equal(imitator.frames.forward_model.gain, model)
    assert [report.episode for report in imitator.reports] == [0, 1]
    step, before = imitator.step(now.percept), untouched.step(same.percept)
    assert step.followed[0].demonstration == 0
    assert step.followed == before.followed
    assert step.action is not None
    assert before.action is not None
    np.testing.assert_array_equal(step.action, before.action)  # the first segment is the same
    now.move(step.action)
    steps_of(imitator, now, 200)
    assert now.is_done
    imitator.reset()
    like = scene(PLAIN, (-0.2, 0.3), (0.4, 0.2))
    assert imitator.step(like.percept).followed[0].demonstration == 1


def test_learning_in_two_calls_is_learning_in_one():
    one, other = demonstrate(scene(PLAIN), 0), demonstrate(scene(PLAIN, (-0.2, 0.3), (0.4, 0.2)), 1)
    at_once = taught(PLAIN, one, other)
    in_turn = Imitator(at_once.config)
    in_turn.learn(shown(PLAIN, one))
    in_turn.learn(shown(PLAIN, other))
    cuts, same = at_once.frames.segments.columns(), in_turn.frames.segments.columns()
    for name, column in cuts.items():
        assert column.tolist() == same[name].tolist()


def test_a_fork_knows_the_same_and_acts_for_itself(learned: Imitator):
    learned.reset()
    now = somewhere(PLAIN, 1)
    steps_of(learned, now, 20)
    other = learned.fork()
    assert_same(learned, other)
    assert other.step(somewhere(PLAIN, 1).percept).followed[0].frame == 0  # at a beginning
    assert learned.step(now.percept).followed[0].frame > 5
    other.learn(shown(PLAIN, demonstrate(scene(PLAIN, (0.1, 0.4)), 1)))
    assert len(other.frames.segments.columns()["frames"]) == 4
    assert len(learned.frames.segments.columns()["frames"]) == 2
    assert len(learned.reports) == 1


@pytest.mark.parametrize("world", [PLAIN, World(3, "place", object_turns=True, hand_turns=True)])
def test_what_is_saved_acts_alike(world: World, tmp_path: Path):
    imitator = taught(world, *[demonstrate(somewhere(world, seed), seed) for seed in range(3)])
    imitator.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    assert loaded.config == imitator.config
    assert loaded.reports == imitator.reports
    assert_same(imitator, loaded)
    imitator.reset()
    for one, same in zip(
        steps_of(imitator, somewhere(world, 5)), steps_of(loaded, somewhere(world, 5)), strict=True
    ):
        np.testing.assert_array_equal(one, same)


def test_a_state_that_is_loaded_takes_the_place_of_another(learned: Imitator):
    other = Imitator(learned.config)
    other.learn(shown(PLAIN, demonstrate(scene(PLAIN, (0.0, 0.4), (0.4, 0.0)))))
    steps_of(other, somewhere(PLAIN, 1), 10)
    other.load_state_dict(learned.state_dict())
    other.reports = [*learned.reports]
    learned.reset()
    pairs = zip(
        steps_of(learned, somewhere(PLAIN, 4)), steps_of(other, somewhere(PLAIN, 4)), strict=True
    )
    for one, same in pairs:
        np.testing.assert_array_equal(one, same)


ROWS = "frames.segments.rows."
NAMES = ("demonstration", "frames", "landmark", "begins")
Damage = dict[str, Callable[[Tensor], Tensor]]


def all_but_one(prefix: str, *names: str) -> Damage:
    return {prefix + name: lambda rows: rows[:-1] for name in names}


def instead(*numbers: int) -> Callable[[Tensor], Tensor]:
    return lambda rows: torch.tensor(numbers, dtype=rows.dtype)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ({ROWS + "frames": lambda rows: rows - 1}, "segments of whole demonstrations"),
        ({ROWS + "frames": lambda rows: rows * 0}, "segments of frames"),
        ({ROWS + "demonstration": instead(0, 1)}, "segments of whole demonstrations"),
        ({ROWS + "demonstration": instead(1, 0)}, "demonstrations in order"),
        ({ROWS + "landmark": instead(2, 0)}, "landmarks there are"),
        ({ROWS + "landmark": instead(-2, 0)}, "landmarks there are"),
        (all_but_one(ROWS, *NAMES), "of whole demonstrations"),
        ({ROWS + "begins": instead(0, 2)}, "beginnings there are"),
        ({ROWS + "begins": instead(1, 1)}, "beginnings there are"),
        ({ROWS + "begins": instead(3, 3)}, "beginnings there are"),
        (all_but_one(ROWS, "landmark"), "rows.landmark of SegmentMemory"),
        (
            {"frames.forward_model.gain": lambda gain: gain * torch.nan},
            r"finite (frames\.forward_model\.)?gain",
        ),
        (
            {"memory.demonstrations.rows": lambda rows: rows - 1}
            | all_but_one("memory.rows.", "percept", "change", "target", "time"),
            "segments of whole demonstrations",
        ),
    ],
)
def test_a_damaged_state_is_refused(
    learned: Imitator, damage: Damage, message: str, tmp_path: Path
):
    """Each of one demonstration in two segments, with one mistake."""
    tensors = {**learned.state_dict()}
    tensors |= {name: change(tensors[name]) for name, change in damage.items()}
    with pytest.raises(ValueError, match=message):
        learned.fork().load_state_dict(tensors)
    learned.save_pretrained(tmp_path)
    fields, _ = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match=message):
        Imitator.from_pretrained(tmp_path)


def test_a_state_of_another_number_of_landmarks_is_refused(learned: Imitator):
    frames = learned.config.frames
    assert frames is not None
    fewer = replace(frames.points, landmarks=frames.points.landmarks[:1])
    goal = frames.points.landmarks[1].place
    other = Imitator(
        replace(
            learned.config,
            frames=replace(
                frames,
                points=fewer,
                smoothing=frames.smoothing[:2],
                others=(*frames.others, *goal),
                ranges=(*frames.ranges, 1.0, 1.0),
            ),
        )
    )
    with pytest.raises(ValueError, match="landmarks there are"):
        other.load_state_dict(learned.state_dict())


def test_what_was_changed_from_outside_is_noticed(learned: Imitator):
    imitator = learned.fork()
    imitator.step(scene(PLAIN).percept)
    imitator.frames.segments.rows.live("frames")[0] += 1
    with pytest.raises(ValueError, match="segments of whole demonstrations"):
        imitator.step(scene(PLAIN).percept)


def test_in_eval_mode_nothing_is_learned(learned: Imitator):
    imitator = learned.fork().eval()
    assert imitator.learn(shown(PLAIN, demonstrate(scene(PLAIN, (0.0, 0.4)), 1))) == []
    assert_same(imitator, learned)


def test_an_imitator_that_knows_nothing_follows_nothing(learned: Imitator):
    step = Imitator(learned.config).step(scene(PLAIN).percept)
    assert step.action is None
    assert step.is_novel
    assert (step.landmark, step.segment, step.followed) == (None, None, ())
