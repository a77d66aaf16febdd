"""Recorded episodes are followed and seen as if they happened now: they tell nothing themselves."""

from dataclasses import replace

import numpy as np
import pytest
import sights
import torch
from sights import TOP

from pacnet.imitator import Imitator


@pytest.fixture(scope="module")
def imitator() -> Imitator:
    shown = sights.demonstrations(6)
    imitator = Imitator.from_demonstrations(shown)
    imitator.learn(shown)
    assert imitator.cameras is not None
    return imitator


def test_what_is_seen_comes_from_the_pictures_alone(imitator: Imitator):
    shown = sights.demonstrations(2, seed=7)
    still = tuple(replace(one, state=torch.zeros_like(one.state)) for one in shown)
    seen, same = imitator.seen(shown), imitator.seen(replace(shown, episodes=still))
    for one, other, known in zip(seen, same, shown, strict=True):
        torch.testing.assert_close(one.encoded, other.encoded, rtol=0, atol=0)
        assert (one.encoded[-1, -2:] - known.state[-1]).norm() < 0.05  # where the hand ends
    assert seen.percept_features["cameras"][-1] == "goal 100%.y"


def test_following_is_stepping_through_frames_and_pictures(imitator: Imitator):
    one = sights.demonstrations(1, seed=7).episodes[0]
    imitator.reset()
    followed = [step.action for step in imitator.follow(one)]
    imitator.reset()
    for frame, action in enumerate(followed):
        step = imitator.step(one.state[frame], {TOP: one.pictures[TOP][frame]})
        np.testing.assert_array_equal(step.action, action)
    pictures = sights.demonstrations(1, seed=8).episodes[0].pictures
    imitator.reset()
    others = [step.action for step in imitator.follow(replace(one, pictures=pictures))]
    assert not np.allclose(followed, others, atol=1e-3)  # the picture decides


def test_each_frame_has_its_own_picture(imitator: Imitator):
    one = sights.demonstrations(1, seed=7).episodes[0]
    bare = sights.demonstrations(1, seed=7, seen=False).episodes[0]
    late = {TOP: np.concatenate([bare.pictures[TOP][:9], one.pictures[TOP][9:]])}
    imitator.reset()
    novel = [step.is_novel for step in imitator.follow(replace(one, pictures=late))]
    assert all(novel[:9])  # the square is put there at the tenth frame
    assert not any(novel[20:])


def test_an_episode_without_pictures_is_named(imitator: Imitator):
    bare = replace(sights.demonstrations(1).episodes[0], pictures={}, episode=12)
    imitator.reset()
    with pytest.raises(ValueError, match=rf"episode 12, frame 0: expected a picture of '{TOP}'"):
        next(imitator.follow(bare))


def test_without_cameras_demonstrations_are_seen_as_they_are():
    shown = sights.demonstrations(3)
    blind = replace(shown, episodes=tuple(replace(one, pictures={}) for one in shown))
    imitator = Imitator.from_demonstrations(blind)
    imitator.learn(blind)
    assert imitator.seen(shown) is shown
    assert len([*imitator.follow(shown.episodes[0])]) == sights.FRAMES
