"""When frames of reference are used: points are asked for or found, and actions move the first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from picking import FPS, World, act, demonstrate, one_demonstration, scene, shown, taught

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.imitator import Imitator
from pacnet.imitator.frames import _whole
from pacnet.schemas.points import Points

PLAIN = World()


def with_frames(one: Demonstration, frames: int) -> Demonstration:
    return replace(
        one, state=one.state[:frames], environment_state=one.environment_state[:frames],
        action=one.action[:frames],
    )  # fmt: skip


def short() -> Demonstrations:
    """Five frames, where six are needed to see over one frame what actions do."""
    return shown(PLAIN, with_frames(demonstrate(scene(PLAIN)), 5))


def motionless() -> Demonstrations:
    one = demonstrate(scene(PLAIN))
    state = one.state.clone()
    state[:, :2] = torch.tensor([0.1, 0.2])
    return shown(PLAIN, replace(one, state=state))


def test_points_are_found_by_their_names_and_used():
    imitator = Imitator.from_demonstrations(one_demonstration(PLAIN))
    imitator.learn(one_demonstration(PLAIN))
    assert imitator.config.points == PLAIN.points
    assert act(imitator, scene(PLAIN, (-0.4, 0.0), (0.4, 0.2)))


@pytest.mark.parametrize(
    ("demonstrations", "message"),
    [
        (short(), "a demonstration of more than 5 frames|at least 6 frames"),
        (motionless(), "expected 'hand' to be what the robot's actions move, it never moves"),
    ],
)
def test_points_that_are_asked_for_must_be_of_use(demonstrations: Demonstrations, message: str):
    with pytest.raises(ValueError, match=message):
        Imitator.from_demonstrations(demonstrations, points=PLAIN.points)
    with pytest.warns(DatasetWarning, match=message.removeprefix("expected ")):
        imitator = Imitator.from_demonstrations(demonstrations)  # those that are found are not
    assert imitator.config.frames is None
    imitator.learn(demonstrations)
    assert imitator.step(demonstrations.episodes[0].percepts[0]).action is not None


def test_the_first_point_is_the_one_that_actions_move():
    """An object that is carried moves as well, but not by what is commanded before that."""
    hand, (thing, goal) = PLAIN.points.moved, PLAIN.points.landmarks
    with pytest.raises(ValueError, match=r"expected 'goal' to be what .* it never moves"):
        Imitator.from_demonstrations(one_demonstration(PLAIN), points=Points(goal, (thing, hand)))
    wrong = Points(thing, (hand, goal))
    told = "got some that move 'hand': name the point first that the robot's actions move"
    with pytest.raises(ValueError, match=told):
        Imitator.from_demonstrations(one_demonstration(PLAIN), points=wrong)


def slider(size: int, seed: int) -> Demonstrations:
    """A carriage goes along its first axis to a box and back, seen with noise of 0.5 mm."""
    random = np.random.default_rng(seed)
    out = 0.1 * np.sin(np.linspace(0, np.pi, 10))  # [m/s]
    speed = np.concatenate([out, -out])
    place = np.zeros((20, size))
    place[1:, 0] = (speed / FPS).cumsum()[:-1]
    state = torch.from_numpy(place + random.normal(0, 0.0005, place.shape)).float()
    box = torch.tensor([0.5, 0.1, 0.2][:size]).expand(20, size)
    names = {
        "observation.state": tuple(f"hand.{axis}" for axis in "xyz"[:size]),
        "observation.environment_state": tuple(f"box.{axis}" for axis in "xyz"[:size]),
        "action": ("speed",),
    }
    action = torch.from_numpy(speed)[:, None].float()
    return Demonstrations(FPS, names, (Demonstration(0, "slide", state, box, action),), "sliding")


@pytest.mark.parametrize(("size", "seed"), [(2, 1), (3, 0)])
def test_a_hand_that_moves_along_one_axis_only_is_moved_by_its_actions(size: int, seed: int):
    """There is nothing to be predicted but noise along the others."""
    points = [f"hand=observation.state[0:{size}]", "box=observation.environment_state"]
    demonstrations = slider(size, seed)
    imitator = Imitator.from_demonstrations(demonstrations, points=points)
    imitator.learn(demonstrations)
    assert imitator.frames is not None
    model = imitator.frames.forward_model
    assert float(model.explained.mean()) < 0.2  # of each axis by itself
    assert model.explained_together(size) > 0.9


def test_points_are_for_targets_that_are_actions():
    demonstrations = one_demonstration(PLAIN)
    wanted = "expected points with targets of 'action', got targets of 'state'"
    with pytest.raises(ValueError, match=wanted):
        Imitator.from_demonstrations(demonstrations, "state", points=PLAIN.points)
    imitator = Imitator.from_demonstrations(demonstrations, "state")  # nothing is asked for
    assert imitator.config.frames is None
    imitator.learn(demonstrations)
    step = imitator.step(demonstrations.episodes[0].percepts[0])
    assert step.action is not None
    assert step.landmark is None


def test_demonstrations_in_which_the_hand_rests_do_not_count_for_the_scenes_size():
    """Two of three; what they show is learned all the same."""
    one, (still,) = demonstrate(scene(PLAIN)), motionless()
    rests = [replace(still, episode=number) for number in (1, 2)]
    imitator = taught(PLAIN, one, *rests)
    frames, alone = imitator.config.frames, taught(PLAIN, one).config.frames
    assert frames is not None
    assert alone is not None
    assert frames.size.extent == alone.size.extent
    assert len(imitator.reports) == 3


def test_what_actions_do_is_learned_from_the_first_demonstration_that_is_long_enough():
    """Until then the shown actions are sent as they are, wherever the hand is."""
    imitator = Imitator.from_demonstrations(one_demonstration(PLAIN), points=PLAIN.points)
    imitator.learn(short())
    assert imitator.frames is not None
    assert not imitator.frames.forward_model.moves.any()
    away = scene(PLAIN)
    away.hand += (0.05, 0.0)
    action = imitator.step(away.percept).action
    assert action is not None
    np.testing.assert_array_equal(action, short().episodes[0].action[0])
    imitator.learn(one_demonstration(PLAIN))
    known = Imitator.from_demonstrations(one_demonstration(PLAIN), points=PLAIN.points)
    known.learn(one_demonstration(PLAIN))
    assert known.frames is not None
    gain = known.frames.forward_model.gain
    assert torch.equal(imitator.frames.forward_model.gain, gain)
    imitator.learn(shown(PLAIN, demonstrate(scene(PLAIN, (-0.2, 0.3), (0.4, 0.2)), 1)))
    assert torch.equal(imitator.frames.forward_model.gain, gain)  # it stays
    assert len(imitator.reports) == 3


def test_an_episode_goes_on_while_what_actions_do_is_learned():
    imitator = Imitator.from_demonstrations(one_demonstration(PLAIN), points=PLAIN.points)
    imitator.learn(short())
    for percept in short().episodes[0].percepts[:4]:
        before = imitator.step(percept)
    imitator.learn(one_demonstration(PLAIN))
    after = imitator.step(short().episodes[0].percepts[4])
    assert after.followed[0].demonstration == before.followed[0].demonstration == 0
    assert after.followed[0].frame >= before.followed[0].frame > 0


def test_points_change_what_is_learned_and_without_them_all_is_as_before():
    plain = Imitator.from_demonstrations(one_demonstration(PLAIN), points=None)
    plain.learn(one_demonstration(PLAIN))
    assert plain.frames is None
    assert not any(name.startswith("frames.") for name in plain.state_dict())
    assert plain.novelty_detector.compared == 1
    framed = taught(PLAIN)
    assert framed.novelty_detector.compared == 0  # it is not asked
    now = scene(PLAIN, (-0.4, 0.0), (0.4, 0.2))
    assert not act(plain, now)


def test_nothing_in_the_settings_depends_on_the_rate_but_numbers_of_frames():
    """Every frame twice as soon, at twice the rate, is the same scene."""
    one = demonstrate(scene(PLAIN))
    slow = Imitator.from_demonstrations(shown(PLAIN, one), points=PLAIN.points).config.frames
    fast = Imitator.from_demonstrations(
        replace(shown(PLAIN, one), fps=2 * FPS), points=PLAIN.points
    ).config.frames
    assert slow is not None
    assert fast is not None
    assert fast.size.extent == slow.size.extent
    assert fast.size.speed == pytest.approx(slow.size.speed, rel=0.01)  # for each frame
    assert fast.ranges == slow.ranges
    assert (slow.forward_model.lead, fast.forward_model.lead) == (1, 2)  # 1/16 s


@pytest.mark.parametrize(
    ("follows", "kept"),
    [
        ((0, 1, -1), (0, 1, -1)),  # told where to go
        ((1, 0, 2), (1, 0, 2)),  # and how to turn, in any order
        ((-1, 1, -1), (-1, -1, -1)),  # one of two alone
        ((0, 0, -1), (-1, -1, -1)),  # one of them twice
        ((0, -1, 2), (-1, -1, 2)),  # a turn, by itself
    ],
)
def test_actions_are_places_in_all_dimensions_that_move_or_in_none(follows, kept):
    """Of a pose of two coordinates and an angle."""
    poses = np.random.default_rng(0).normal(size=(20, 3))
    assert _whole(follows, poses, 2) == kept
    still = poses * (1, 0, 1)  # then the first coordinate is all of the place
    expected = (0, -1, 2) if follows == (0, -1, 2) else kept
    assert _whole(follows, still, 2) == expected


@pytest.mark.parametrize("points", [None, "auto", PLAIN.points])
def test_an_episode_without_frames_is_named(points):
    one = demonstrate(scene(PLAIN))
    with pytest.raises(ValueError, match="episode 3: expected one or more frames, got none"):
        Imitator.from_demonstrations(
            shown(PLAIN, one, replace(with_frames(one, 0), episode=3)), points=points
        )


@pytest.mark.parametrize("points", [None, "auto", PLAIN.points])
@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_a_number_that_is_not_finite_is_named(points, value: float):
    one = demonstrate(scene(PLAIN))
    around = one.environment_state.clone()
    around[3, 2] = value
    odd = replace(one, environment_state=around, episode=3)
    with pytest.raises(ValueError, match=rf"episode 3: expected a finite 'goal\.x', got {value}"):
        Imitator.from_demonstrations(shown(PLAIN, one, odd), points=points)
