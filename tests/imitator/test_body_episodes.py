"""A body learns from episodes with gaps, of several tasks, or in which nothing is done."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from arms import ArmScene, ArmWorld, body, demonstrate, shown
from lifting import CUP, arm, lift, lifts

from pacnet.datasets.demonstrations import Demonstration
from pacnet.imitator import Imitator

WORLD = ArmWorld()
ELSEWHERE = (0.4, 0.2, 0.15)
MISSED = 0.02  # [m]


def taught(*episodes: Demonstration) -> Imitator:
    demonstrations = shown(WORLD, *episodes)
    imitator = Imitator.from_demonstrations(demonstrations, body=body())
    imitator.learn(demonstrations)
    return imitator


def without(shown: Demonstration, first: float, end: float) -> Demonstration:
    """The same without the frames between two times [s]."""
    begin, after = round(first * WORLD.fps), round(end * WORLD.fps)
    keep = torch.ones(len(shown.state), dtype=torch.bool)
    keep[begin:after] = False
    rows = {name: getattr(shown, name)[keep] for name in ("state", "environment_state", "action")}
    return replace(shown, **rows, gaps=(begin,))


def done(imitator: Imitator, now: ArmScene) -> bool:
    """Act; return whether the object was taken to the mouth and back."""
    imitator.reset()
    for _ in range(round(15 * WORLD.fps)):
        step = imitator.step(now.percept)
        if step.action is not None:
            now.move(step.action)
    return now.passed() < MISSED and now.missed < MISSED and now.held is None


@pytest.mark.parametrize("begins", [1.0, 2.3, 2.7])
def test_what_is_carried_across_a_gap_is_put_back_to_where_it_stood(begins: float):
    """Before, where it stood was taken to be where it was after the gap."""
    imitator = taught(without(demonstrate(ArmScene(WORLD)), begins, begins + 0.2))
    assert [len(cut.segments) > 0 for cut in imitator.cuts] == [True, True]
    assert imitator.config.frames is not None
    assert imitator.config.frames.put_back == (0,)
    assert done(imitator, ArmScene(WORLD, np.array(ELSEWHERE)))


def test_the_cuts_of_an_episode_to_learn_are_those_that_are_learned():
    """Where things stood is remembered across its gaps by `pacnet watch` too."""
    parted = without(demonstrate(ArmScene(WORLD)), 2.6, 2.8)
    imitator = taught(parted)
    assert imitator.frames is not None
    learned = imitator.frames.segments.columns()
    landmark = learned["landmark"].repeat(learned["frames"])
    np.testing.assert_array_equal(imitator.frames.approach(parted).landmark, landmark)


def left_lifted(number: int) -> Demonstration:
    """It is taken away, and not put back."""
    one = lift(number, (0.33, 0.02 * number, 0.02))
    rows = {name: getattr(one, name)[:72] for name in ("state", "environment_state", "action")}
    return replace(one, **rows)


@pytest.mark.parametrize(("task", "known"), [("lift the cup", False), ("take it away", True)])
def test_what_most_of_one_task_put_back_has_a_place(task: str, known: bool):
    """One of four episodes puts it back: as one of four of its task, or as the only one."""
    others = [replace(left_lifted(number), task=task) for number in (1, 2, 3)]
    both = replace(lifts(), episodes=(lift(), *others))
    imitator = Imitator.from_demonstrations(both, points=[CUP], body=arm())
    assert imitator.config.points is not None
    assert ("cup's place" in imitator.config.points.names) is known


def test_episodes_in_which_nothing_moves_do_not_make_the_scene_small():
    once = lift()
    still = once.state[:1].expand_as(once.state)
    around = once.environment_state[:1].expand_as(once.environment_state)
    rests = [
        replace(once, episode=number, state=still, environment_state=around, action=still)
        for number in (1, 2)
    ]
    alone, among = (
        Imitator.from_demonstrations(replace(lifts(), episodes=episodes), points=[CUP], body=arm())
        for episodes in ((once,), (once, *rests))
    )
    assert alone.config.frames is not None
    assert among.config.frames is not None
    # Other episodes make it surer how noisy places are, so they are smoothed a little otherwise.
    extents = [one.config.frames.size.extent for one in (alone, among) if one.config.frames]
    assert extents[1] == pytest.approx(extents[0], rel=0.02)


def test_a_hand_that_takes_it_turned_otherwise_is_turned_to_what_was_shown_by_and_by():
    """It takes the object in another direction, atan(.2 / .4) instead of atan(.1 / .4)."""
    world = ArmWorld(seen="place")
    demonstrations = shown(world)
    imitator = Imitator.from_demonstrations(demonstrations, body=body())
    imitator.learn(demonstrations)
    now = ArmScene(world, np.array(ELSEWHERE))
    while (step := imitator.step(now.percept)).landmark == "object":
        assert step.action is not None
        now.move(step.action)
    assert imitator._framed_follower is not None
    offset = imitator._framed_follower.state.offset_turn
    assert offset[2] == pytest.approx(math.atan2(0.2, 0.4) - math.atan2(0.1, 0.4), abs=0.05)
