"""A robot of joint angles alone: its camera tells a posture, and the way there is warped."""

from dataclasses import replace

import numpy as np
import pytest
from touching import REST, TOP, demonstrations, episode, miss, picture_of, places, shown_as, taught

from pacnet.datasets.format import DatasetWarning
from pacnet.imitator.imitator import Imitator


@pytest.fixture(scope="module")
def imitator():
    return taught(demonstrations(8))


def test_the_hand_gets_to_places_that_were_not_shown(imitator):
    assert imitator.config.frames is None
    assert not imitator.config.tells_places
    assert [report.kind for report in imitator.camera_reports] == ["patches"]
    missed = [miss(imitator, place) for place in places(10, seed=1)]
    assert np.median(missed) < 0.03  # places are .2 apart on the mean
    alone = taught(demonstrations(8), encoder="none")
    assert np.median([miss(alone, place, False) for place in places(10, seed=1)]) > 0.1


def test_an_absent_ball_is_novel_and_nothing_is_done(imitator):
    imitator.reset()
    step = imitator.step(REST.astype(np.float32), {TOP: picture_of((-5, -5))})
    assert step.is_novel
    assert step.dimension == TOP
    assert step.action is None


def test_a_checkpoint_does_the_same(imitator, tmp_path):
    imitator.save_pretrained(tmp_path)
    loaded = Imitator.from_pretrained(tmp_path)
    for one in (imitator, loaded):
        one.reset()
    for place in places(3, seed=2):
        pictures = {TOP: picture_of(place)}
        mine, other = (
            one.step(REST.astype(np.float32), pictures).action for one in (imitator, loaded)
        )
        np.testing.assert_array_equal(mine, other)


def test_more_demonstrations_are_followed_where_they_are_nearer(imitator):
    other = imitator.fork()
    place = np.array([0.3, 0.75])
    before = miss(other, place)
    other.learn(shown_as(episode(20, place)))
    assert at(other, place) == {8}
    assert miss(other, place) < before


def test_actions_that_are_no_places_leave_the_camera_unused():
    shown = demonstrations(6, absolute=False)
    with pytest.warns(DatasetWarning, match="neither places of the robot's state"):
        made = Imitator.from_demonstrations(shown)
    assert made.cameras is None


def test_targets_that_are_states_leave_the_camera_unused():
    with pytest.warns(DatasetWarning, match="cameras are not used: targets are states"):
        made = Imitator.from_demonstrations(demonstrations(6), targets="state")
    assert made.cameras is None


def at(imitator, place, task=None):
    """The demonstrations that are followed in the first moment."""
    imitator.reset(task)
    step = imitator.step(REST.astype(np.float32), {TOP: picture_of(place)})
    return {one.demonstration for one in step.followed}


def bare(shown, **fields):
    return replace(shown, episodes=tuple(replace(one, pictures={}, **fields) for one in shown))


def test_another_task_at_the_same_place_is_another_demonstration():
    """The same pictures, but each task was shown on its own."""
    shown = demonstrations(8)
    tasks = [replace(one, task="touch" if one.episode < 4 else "push") for one in shown]
    shown = replace(shown, episodes=tuple(tasks))
    imitator = taught(shown)
    place = places(1, seed=1)[0]
    assert at(imitator, place, "touch") < {*range(4)}
    assert at(imitator, place, "push") < {*range(4, 8)}


def test_what_has_no_pictures_is_no_part_of_what_was_shown_before_it(imitator):
    """The last one with pictures ends where it did, whatever is learned after it."""
    place = places(8, seed=0)[7]
    assert at(imitator, place) == {7}
    other = imitator.fork()
    other.learn(bare(demonstrations(2, seed=3)))
    assert at(other, place) == {7}
    near = place + 0.03
    assert miss(other, near) == miss(imitator, near)


def test_parts_between_gaps_are_one_demonstration():
    shown = demonstrations(8)
    parted = replace(shown, episodes=tuple(replace(one, gaps=(20,)) for one in shown))
    imitator = taught(parted)
    assert len(imitator.reports) == 16
    imitator.learn(bare(demonstrations(1, seed=3)))
    told = imitator.cameras.goals_shown()
    np.testing.assert_array_equal(told.first, range(0, 16, 2))
    np.testing.assert_array_equal(told.end, range(2, 18, 2))


def test_it_acts_before_all_is_learned():
    """Nothing is followed yet, one demonstration is known, and none has pictures."""
    shown = demonstrations(8)
    place = places(1, seed=1)[0]
    imitator = Imitator.from_demonstrations(shown)
    assert at(imitator, place) == set()
    known = []
    imitator.learn(shown, lambda _: known.append(at(imitator, place)))
    assert all(of <= {*range(number + 1)} and of for number, of in enumerate(known))
    blind = Imitator.from_demonstrations(shown)
    blind.learn(bare(shown))
    assert at(blind, place)


def test_a_loaded_state_is_told_anew(imitator):
    other = demonstrations(8, seed=5)
    second = taught(other)
    first = imitator.fork()
    before = first.cameras.goals_shown()
    first.cameras.load_state_dict(second.cameras.state_dict())
    after, wanted = first.cameras.goals_shown().goals, second.cameras.goals_shown().goals
    np.testing.assert_array_equal(after, wanted)
    assert not np.array_equal(before.goals, after)


@pytest.mark.parametrize(("name", "value"), [("demonstration", 2**62), ("parts", 0), ("parts", 9)])
def test_numbers_that_contradict_one_another_are_refused(imitator, name, value):
    state = imitator.state_dict()
    state[f"cameras.parts.0.shown.{name}"][0] = value
    with pytest.raises(ValueError, match="demonstrations in order"):
        imitator.fork().load_state_dict(state)


def test_a_percept_that_is_refused_is_no_look(imitator):
    imitator.reset()
    absent = {TOP: picture_of((-5, -5))}
    with pytest.raises(ValueError, match="finite percept"):
        imitator.step(np.full(2, np.nan, np.float32), absent)
    step = imitator.step(REST.astype(np.float32), {TOP: picture_of((0.5, 0.5))})
    assert not step.is_novel  # one absent ball and one that is there would be half and half
