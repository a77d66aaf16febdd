"""A robot of joint angles alone: its camera tells a posture, and the way there is warped."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.imitator.imitator import Imitator

TOP = "observation.images.top"
LENGTHS = np.array([0.5, 0.5])
REST = np.array([0.4, 0.9])
FRAMES, FPS = 50, 25  # frames, [1/s]


def hand_at(angles):
    """Where the hand of a planar arm is."""
    turned = np.cumsum(angles)
    return np.array([(LENGTHS * np.cos(turned)).sum(), (LENGTHS * np.sin(turned)).sum()])


def angles_at(place):
    """The elbow-up angles that take the hand to a place."""
    x, y = place
    cosine = (x * x + y * y - (LENGTHS**2).sum()) / (2 * LENGTHS.prod())
    elbow = np.arccos(np.clip(cosine, -1, 1))
    shoulder = np.arctan2(y, x) - np.arctan2(
        LENGTHS[1] * np.sin(elbow), LENGTHS[0] + LENGTHS[1] * np.cos(elbow)
    )
    return np.array([shoulder, elbow])


def picture_of(place):
    """A ball on a floor with structure, from above."""
    rows, columns = np.mgrid[:80, :96]
    image = np.stack([90 + rows, 60 + columns, 80 + (rows * columns) % 23], 2).astype(np.uint8)
    row, column = 70 - 60 * place[1], 10 + 75 * place[0]
    image[(rows - row) ** 2 + (columns - column) ** 2 < 30] = (250, 220, 40)
    image[(rows - row - 2) ** 2 + (columns - column) ** 2 < 5] = (20, 20, 160)
    return image


def places(count, seed):
    return np.random.default_rng(seed).uniform((0.35, 0.3), (0.75, 0.7), (count, 2))


def episode(number, place, absolute=True):
    """From rest to the ball, then still; actions are the angles to go to, or changes of them."""
    along = np.clip(np.linspace(0, 1.4, FRAMES), 0, 1)[:, None]
    wanted = REST + along * along * (3 - 2 * along) * (angles_at(place) - REST)
    state, angles = [], REST.copy()
    for target in wanted:
        state.append(angles.copy())
        angles = angles + 0.6 * (target - angles)
    action = wanted if absolute else np.gradient(wanted, axis=0)
    return Demonstration(
        number,
        "touch",
        torch.tensor(np.array(state)).float(),
        torch.empty(FRAMES, 0),
        torch.tensor(action).float(),
        pictures={TOP: np.repeat(picture_of(place)[None], FRAMES, axis=0)},
    )


def demonstrations(count, seed=0, **kinds):
    joints = ("shoulder.pos", "elbow.pos")
    shown = tuple(episode(n, place, **kinds) for n, place in enumerate(places(count, seed)))
    return Demonstrations(FPS, {"observation.state": joints, "action": joints}, shown, "arm")


def miss(imitator, place, pictures=True):
    """How far from the ball the hand ends."""
    imitator.reset()
    angles = action = REST.copy()
    for _ in range(FRAMES + 20):
        seen = {TOP: picture_of(place)} if pictures else None
        step = imitator.step(angles.astype(np.float32), seen)
        action = action if step.action is None else step.action
        angles = angles + 0.6 * (action - angles)
    return np.linalg.norm(hand_at(angles) - place)


@pytest.fixture(scope="module")
def imitator():
    shown = demonstrations(8)
    made = Imitator.from_demonstrations(shown)
    made.learn(shown)
    return made


def test_the_hand_gets_to_places_that_were_not_shown(imitator):
    assert imitator.config.frames is None
    assert not imitator.config.tells_places
    assert [report.kind for report in imitator.camera_reports] == ["patches"]
    missed = [miss(imitator, place) for place in places(10, seed=1)]
    assert np.median(missed) < 0.03  # places are .2 apart on the mean
    blind = demonstrations(8)
    alone = Imitator.from_demonstrations(blind, encoder="none")
    alone.learn(blind)
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
    taught = imitator.fork()
    place = np.array([0.3, 0.75])
    before = miss(taught, place)
    more = demonstrations(1)
    near = Demonstrations(FPS, more.names, (episode(20, place),), "more")
    taught.learn(near)
    taught.reset()
    step = taught.step(REST.astype(np.float32), {TOP: picture_of(place)})
    assert taught.reports[step.followed[0].demonstration].episode == 20
    assert miss(taught, place) < before


def test_actions_that_are_no_places_leave_the_camera_unused():
    shown = demonstrations(6, absolute=False)
    with pytest.warns(DatasetWarning, match="neither places of the robot's state"):
        made = Imitator.from_demonstrations(shown)
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
    imitator = Imitator.from_demonstrations(shown)
    imitator.learn(shown)
    place = places(1, seed=1)[0]
    assert at(imitator, place, "touch") < {*range(4)}
    assert at(imitator, place, "push") < {*range(4, 8)}


def test_what_has_no_pictures_is_no_part_of_what_was_shown_before_it(imitator):
    """The last one with pictures ends where it did, whatever is learned after it."""
    place = places(8, seed=0)[7]
    assert at(imitator, place) == {7}
    taught = imitator.fork()
    taught.learn(bare(demonstrations(2, seed=3)))
    assert at(taught, place) == {7}
    near = place + 0.03
    assert miss(taught, near) == miss(imitator, near)


def test_parts_between_gaps_are_one_demonstration():
    shown = demonstrations(8)
    parted = replace(shown, episodes=tuple(replace(one, gaps=(20,)) for one in shown))
    imitator = Imitator.from_demonstrations(parted)
    imitator.learn(parted)
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
    second = Imitator.from_demonstrations(other)
    second.learn(other)
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
