"""One demonstration is enough wherever things stand, however they are perceived and commanded."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from picking import (
    Scene,
    World,
    act,
    demonstrate,
    one_demonstration,
    scene,
    somewhere,
    taught,
)

from pacnet.imitator import Imitator

PLACEMENTS = range(6)
PLAIN, SPACE = World(), World(3)


def successes(world: World, imitator: Imitator, angle: float = 0.0) -> int:
    """In how many placements the object is taken to the goal."""
    done = 0
    for seed in PLACEMENTS:
        now = somewhere(world, seed)
        now.angle = angle
        done += act(imitator, now)
    return done


class Nearest:
    """Does what was done at the nearest percept, each dimension in its standard deviations."""

    def __init__(self, world: World) -> None:
        (one,) = one_demonstration(world)
        self._rows, self._actions = one.percepts.numpy(), one.action.numpy()
        self._spread = np.maximum(self._rows.std(axis=0), 0.1)

    def act(self, now: Scene) -> bool:
        """Return whether the object is at the goal in the end."""
        for _ in range(250):
            apart = ((self._rows - now.percept) / self._spread) ** 2
            now.move(self._actions[apart.sum(axis=1).argmin()])
        return now.is_done


@pytest.mark.parametrize("world", [PLAIN, SPACE])
def test_one_demonstration_is_enough_wherever_the_object_and_the_goal_are(world: World):
    assert successes(world, taught(world)) == len(PLACEMENTS)
    nearest = Nearest(world)
    assert nearest.act(scene(world))  # as it was shown
    assert sum(nearest.act(somewhere(world, seed)) for seed in PLACEMENTS) == 0


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("command", ["displacement", "place"])
def test_actions_may_be_displacements_or_places(command, size: int):
    world = World(size, command)
    imitator = taught(world)
    assert successes(world, imitator) >= len(PLACEMENTS) - 1
    frames = imitator.config.frames
    assert frames is not None
    places = (*range(size), -1) if command == "place" else (-1,) * (size + 1)
    assert frames.forward_model.follows == places


@pytest.mark.parametrize("command", ["velocity", "place"])
def test_percepts_may_be_in_millimetres(command):
    world = World(2, command, unit=1000.0)
    assert successes(world, taught(world)) == len(PLACEMENTS)


def test_the_unit_of_percepts_changes_no_action():
    """Speeds are in metres in both worlds; percepts are single, so a little differs."""
    metres, millimetres = PLAIN, World(unit=1000.0)
    one, other = taught(metres), taught(millimetres)
    now, same = somewhere(metres, 1), somewhere(millimetres, 1)
    for _ in range(40):
        first, second = one.step(now.percept).action, other.step(same.percept).action
        assert first is not None
        np.testing.assert_allclose(first, second, atol=1e-3)
        now.move(first)
        same.move(first)


@pytest.mark.parametrize("size", [2, 3])
def test_percepts_may_have_other_axes_than_actions(size: int):
    world = World(size, axes=math.pi / 6)
    assert successes(world, taught(world)) == len(PLACEMENTS)


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("hand_turns", [False, True])
def test_an_object_whose_side_matters_may_be_turned(size: int, hand_turns: bool):
    """An orientation is an angle in two dimensions, a quaternion in three."""
    world = World(size, object_turns=True, hand_turns=hand_turns)
    assert successes(world, taught(world), angle=math.pi / 3) == len(PLACEMENTS)


def test_without_its_orientation_it_is_grasped_where_it_was():
    """A second check that the side matters: as if the object had none."""
    world = World(object_turns=True)
    points = world.points
    thing, goal = points.landmarks
    blind = type(points)(points.moved, (type(thing)(thing.name, thing.place), goal))
    demonstrations = one_demonstration(world)
    imitator = Imitator.from_demonstrations(demonstrations, points=blind)
    imitator.learn(demonstrations)
    assert successes(world, imitator, angle=math.pi / 3) == 0


def test_a_hand_turns_otherwise_than_it_moves():
    """Speed comes about with a lag of 0.3 a frame, a turn at once: 1/20 s each frame."""
    world = World(object_turns=True, hand_turns=True)
    model = taught(world).frames.forward_model
    gain, lag = model.gain.numpy(), model.lag.numpy()
    np.testing.assert_allclose(gain[:2, :2], 0.3 / 20 * np.eye(2), atol=2e-3)
    np.testing.assert_allclose(lag[:2, :2], 0.7 * np.eye(2), atol=0.1)
    np.testing.assert_allclose(gain[2], [0, 0, 1 / 20, 0], atol=5e-3)
    assert abs(gain[:2, 2]).max() < 1e-3
    assert abs(lag[2, 2]) < 0.1


def test_an_action_is_no_larger_than_those_that_were_shown_in_any_direction():
    """The demonstration goes up and to the left, and is no faster than 0.3 m/s."""
    imitator, sizes = taught(PLAIN), []
    (one,) = one_demonstration(PLAIN)
    most = one.action[:, :2].abs().max().item()
    now = scene(PLAIN, (-0.4, -0.5), (0.5, -0.4))  # down, then to the right
    for _ in range(200):
        action = imitator.step(now.percept).action
        assert action is not None
        assert 0 <= action[2] <= 1
        sizes.append(np.abs(action[:2]).max())
        now.move(action)
    assert now.is_done
    assert max(sizes) == pytest.approx(most, rel=0.05)
    assert max(sizes) <= most * (1 + 1e-6)


def test_a_speed_that_is_a_coordinate_by_chance_is_no_place():
    """A speed in y of 0.3 - z where z is 0.3 at first, as of a script of feedback."""
    world = SPACE
    imitator = taught(world)
    frames = imitator.config.frames
    assert frames is not None
    assert imitator.config.follows[1] >= 0  # by its numbers it is one, taken for itself
    assert frames.forward_model.follows == (-1, -1, -1, -1)


def test_a_step_says_where_it_is_going():
    imitator, now = taught(PLAIN), somewhere(PLAIN, 3)
    steps = []
    for _ in range(220):
        step = imitator.step(now.percept)
        assert step.action is not None
        assert step.target is not None
        assert step.action.tolist() == step.target.tolist()
        steps.append(step)
        now.move(step.action)
    assert [step.landmark for step in steps[::219]] == ["object", "goal"]
    assert [step.segment for step in steps[::219]] == [0, 1]
    progress = [step.progress for step in steps]
    assert progress == sorted(progress)  # nothing went wrong
    assert progress[0] == 0.0
    assert progress[-1] == 1.0
    assert [step.is_done for step in steps[::219]] == [False, True]
    assert {len(step.followed) for step in steps} == {1}
    assert steps[0].followed[0]._asdict() == {"demonstration": 0, "frame": 0, "weight": 1.0}


def test_of_what_is_no_landmark_nothing_is_said_without_frames():
    demonstrations = one_demonstration(PLAIN)
    imitator = Imitator.from_demonstrations(demonstrations, points=None)
    imitator.learn(demonstrations)
    step = imitator.step(demonstrations.episodes[0].percepts[0])
    assert (step.landmark, step.segment) == (None, None)


def test_a_demonstration_of_a_single_frame_beside_others_is_learned():
    one = demonstrate(scene(PLAIN))
    first = {"state": one.state[:1], "environment_state": one.environment_state[:1]}
    imitator = taught(PLAIN, one, replace(one, episode=1, action=one.action[:1], **first))
    assert [report.frames for report in imitator.reports] == [len(one.state), 1]
    assert act(imitator, scene(PLAIN))
