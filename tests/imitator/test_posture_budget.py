"""An arm that sees postures, whose memory is bounded: pictures go with their demonstrations."""

import numpy as np
import pytest
from touching import FRAMES, REST, TOP, demonstrations, hand_at, miss, picture_of, places, taught

from pacnet.imitator import Imitator

BUDGET = 100  # frames, of which five demonstrations are kept


@pytest.fixture(scope="module")
def imitator() -> Imitator:
    return taught(demonstrations(8), budget=BUDGET)


def kept(imitator):
    """Numbers of the demonstrations of which something is kept."""
    return imitator.memory.demonstrations.live("rows").nonzero().flatten().tolist()


def test_pictures_are_kept_of_what_may_be_followed(imitator):
    assert len(kept(imitator)) == BUDGET // 20
    shown = imitator.cameras.encoders[TOP].shown
    assert shown.live("demonstration").tolist() == kept(imitator)
    other = imitator.fork()
    for seed in range(10, 14):
        other.learn(demonstrations(2, seed=seed))
    shown = other.cameras.encoders[TOP].shown
    assert shown.live("demonstration").tolist() == kept(other)
    assert max(kept(other)) == 15
    assert len(shown) <= BUDGET // 20
    other.check_state(other.state_dict())


def test_the_nearest_that_is_kept_is_followed(imitator):
    unseen = [miss(imitator, place) for place in places(10, seed=1)]
    forgotten = [miss(imitator, place) for place in places(8, seed=0)]
    assert np.median(unseen) < 0.03
    assert max(unseen + forgotten) < 0.06


def test_while_it_learns_what_is_kept_is_followed(imitator):
    """Between two demonstrations, before their pictures are looked at."""
    other, missed = imitator.fork(), []
    place = places(8, seed=0)[0]
    other.learn(demonstrations(6, seed=5), lambda _: missed.append(miss(other.fork(), place)))
    assert 0 not in kept(other)
    assert max(missed) < 0.06


def test_an_episode_that_looks_no_longer_goes_on_while_something_is_learned(imitator):
    """Rows have other numbers then; where the ball was is what was seen."""
    place, other = places(1, seed=1)[0], imitator.fork()
    angles = action = REST.copy()
    for _ in range(FRAMES + 20):
        seen = {TOP: picture_of(place)} if other.is_looking else None
        step = other.step(angles.astype(np.float32), seen)
        action = action if step.action is None else step.action
        angles = angles + 0.6 * (action - angles)
        if seen is None and len(other.reports) == 8:
            other.learn(demonstrations(1, seed=5))
            assert not other.is_looking
    assert len(other.reports) == 9
    assert np.linalg.norm(hand_at(angles) - place) < 0.06
