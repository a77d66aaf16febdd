"""Novelty in frames of reference: in a step, in a report and in recognition it is the same."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from picking import World, demonstrate, one_demonstration, scene, shown, somewhere, taught

from pacnet.imitator import Imitator
from pacnet.imitator.novelty import NOVEL
from pacnet.schemas.scene import scene_at, scene_of

PLAIN = World()


@pytest.fixture(scope="module")
def learned() -> Imitator:
    return taught(PLAIN)


def farthest(world: World) -> float:
    """Thrice the largest distance of two points that was shown, a second time."""
    (one,) = one_demonstration(world)
    rows, points = one.percepts.double(), [*world.points]
    places = [rows[:, list(point.place)] for point in points]
    pairs = [(a - b).norm(dim=1).max() for a in places for b in places]
    return 3 * float(max(pairs))


def test_a_landmark_ten_times_as_far_as_any_is_novel(learned: Imitator):
    learned.reset()
    far = scene(PLAIN, (0.3, 0.1), (10.0, -0.4))
    step = learned.step(far.percept)
    assert step.is_novel
    assert step.action is None
    assert step.target is not None  # what it would do
    assert step.dimension == "goal.x"
    assert step.deviation == pytest.approx(10.0)  # from the hand, at the origin
    assert step.threshold == pytest.approx(farthest(PLAIN), rel=1e-5)
    assert step.novelty == pytest.approx(10.0 / farthest(PLAIN), rel=1e-5)
    assert learned.step(scene(PLAIN).percept).action is not None  # it is novel only while it is so


def test_what_is_told_of_novelty_is_in_the_unit_of_percepts():
    world = World(3, unit=1000.0)
    step = taught(world).step(scene(world, (0.3, 0.1, -9.0)).percept)
    assert step.is_novel
    assert step.dimension == "object.z"
    assert step.deviation == pytest.approx(-9300, rel=1e-5)  # the hand is at 300 mm
    assert step.threshold == pytest.approx(farthest(world), rel=1e-5)


@pytest.mark.parametrize(("gripper", "is_novel"), [(1, False), (1, True), (-1, True)])
def test_what_is_no_place_is_novel_twice_its_range_beyond_it(
    learned: Imitator, gripper: int, is_novel: bool
):
    """Of a gripper; its range counts as two deviations, if that is more."""
    (one,) = one_demonstration(PLAIN)
    openings = one.percepts[:, 2].double()
    low, high, frames = float(openings.min()), float(openings.max()), learned.config.frames
    assert frames is not None
    (span,) = frames.ranges
    limit = (high - low) / 2 + 2 * span
    percept = scene(PLAIN).percept
    percept[2] = (high + low) / 2 + (limit if gripper > 0 else -limit) * (1.05 if is_novel else 0.9)
    learned.reset()
    step = learned.step(percept)
    assert step.is_novel == is_novel
    assert (step.action is None) == is_novel
    assert step.dimension == "gripper"
    assert step.threshold == pytest.approx(limit, rel=1e-5)
    assert step.deviation == pytest.approx(float(percept[2]) - (high + low) / 2, rel=1e-5)


def test_where_things_are_is_not_novel(learned: Imitator):
    for seed in range(20):
        learned.reset()
        assert not learned.step(somewhere(PLAIN, seed).percept).is_novel


def test_the_novelty_of_a_report_is_the_largest_of_its_steps(learned: Imitator):
    """Of a demonstration with an object far away, and a gripper that opens too far."""
    imitator = learned.fork()
    one = demonstrate(scene(PLAIN), 1)
    one.environment_state[:, 0] += 1
    one.state[5:9, 2] = 9.4
    steps = [imitator.step(percept) for percept in one.percepts]
    (report,) = imitator.learn(shown(PLAIN, one))
    assert report.max_novelty == pytest.approx(max(step.novelty for step in steps), rel=1e-6)
    assert report.max_novelty > NOVEL
    assert imitator.reports[0].max_novelty is None
    (again,) = imitator.learn(shown(PLAIN, one))
    assert again.max_novelty is not None
    assert again.max_novelty <= NOVEL


def test_the_novelty_of_recognition_is_that_of_steps(learned: Imitator):
    rows = torch.from_numpy(np.stack([somewhere(PLAIN, seed).percept for seed in range(12)]))
    rows[3, 2] = 5.0  # the gripper
    rows[7, 5] = -40.0  # the goal
    learned.reset()
    steps = [learned.step(row) for row in rows]
    seen = learned.recognise(rows)
    assert seen.novelty.tolist() == pytest.approx([one.novelty for one in steps], rel=1e-6)
    assert seen.is_novel.tolist() == [one.is_novel for one in steps]
    assert seen.is_novel.nonzero().ravel().tolist() == [3, 7]


def test_recognition_leaves_an_episode_as_it_is(learned: Imitator):
    now, same = somewhere(PLAIN, 1), somewhere(PLAIN, 1)
    other = learned.fork()
    learned.reset()
    for _ in range(20):
        step, alike = learned.step(now.percept), other.step(same.percept)
        other.recognise(torch.from_numpy(np.stack([same.percept] * 2)))
        assert step.action is not None
        assert alike.action is not None
        np.testing.assert_array_equal(step.action, alike.action)
        now.move(step.action)
        same.move(alike.action)


@pytest.mark.parametrize("world", [PLAIN, World(3, object_turns=True, hand_turns=True)])
def test_a_step_refuses_what_it_refuses_without_frames(world: World):
    demonstrations = one_demonstration(world)
    framed, plain = taught(world), Imitator.from_demonstrations(demonstrations, points=None)
    plain.learn(demonstrations)
    percept = scene(world).percept
    wrong = [percept[:-1], percept.astype(np.float64), percept * np.float32(np.nan)]
    wrong += [percept + np.float32(np.inf), percept + np.float32(3e38)]
    for one in wrong:
        errors = []
        for imitator in (framed, plain):
            with pytest.raises(ValueError, match="expected") as error:
                imitator.step(one)
            errors.append(str(error.value))
        assert errors[0] == errors[1]
    for one in (percept * 0, percept - 1e6, percept * np.float32(1e6), torch.from_numpy(percept)):
        assert plain.step(one).novelty >= 0
        step = framed.step(one)
        assert step.novelty >= 0
        assert step.target is not None
        assert np.isfinite(step.target).all()


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("turns", [False, True])
def test_one_percept_is_read_as_several_are(size: int, turns: bool):
    world = World(size, object_turns=turns, hand_turns=turns)
    random = np.random.default_rng(size)
    rows = random.normal(0, 2, (50, len(world.points.used) + 1)).astype(np.float32)
    rows[0] = 0  # without a turn
    scenes = scene_of(rows, world.points)
    for row, places, orientations in zip(rows, *scenes, strict=True):
        one, turned = scene_at(row, world.points)
        np.testing.assert_array_equal(one, places)
        np.testing.assert_allclose(turned, orientations, rtol=1e-14, atol=1e-15)
        assert math.isclose(np.linalg.norm(turned[0]), 1, rel_tol=1e-12)


def test_what_never_changed_is_not_novel():
    """A second object that is no point, and stood still in the demonstration."""
    (one,) = one_demonstration(PLAIN)
    there = torch.full((len(one.state), 1), 0.2)
    around = torch.cat([one.environment_state, there], dim=1)
    shown_once = one_demonstration(PLAIN)
    names = dict(shown_once.names)
    names["observation.environment_state"] = (*names["observation.environment_state"], "shelf")
    with_shelf = replace(
        shown_once, names=names, episodes=(replace(one, environment_state=around),)
    )
    imitator = Imitator.from_demonstrations(with_shelf)
    imitator.learn(with_shelf)
    percept = np.append(scene(PLAIN).percept, np.float32(7.0))
    assert imitator.step(percept).action is not None
