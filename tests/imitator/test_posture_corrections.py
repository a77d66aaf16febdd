"""Corrections of an arm that sees postures: they begin where no demonstration ever was."""

from dataclasses import replace

import numpy as np
import pytest
from touching import (
    FRAMES,
    REST,
    TOP,
    demonstrations,
    episode,
    miss,
    path,
    picture_of,
    places,
    shown_as,
    taught,
)

from pacnet.imitator import Imitator

ASIDE = REST + np.array([0.6, -0.8])  # [rad], where no demonstration comes by
UNSEEN = places(8, seed=1)


@pytest.fixture(scope="module")
def imitator() -> Imitator:
    return taught(demonstrations(8))


def corrected(imitator, *parts):
    """The same imitator, after corrections."""
    other = imitator.fork()
    other.learn(shown_as(*parts, source="corrections"), corrections=True)
    return other


def missed(imitator, start):
    """The median over places of the ball that were not shown."""
    return np.median([miss(imitator, place, start=start) for place in UNSEEN])


def first_step(imitator, start, place):
    imitator.reset()
    return imitator.step(start.astype(np.float32), {TOP: picture_of(place)})


@pytest.mark.parametrize("first_frame", [0, 20], ids=["whole", "from the middle"])
def test_from_where_it_was_corrected_the_hand_gets_to_unseen_places(imitator, first_frame):
    """The ball was elsewhere while it was corrected."""
    place = UNSEEN[1]
    assert first_step(imitator, ASIDE, place).is_novel
    before = missed(imitator, ASIDE)
    part = episode(20, places(1, seed=3)[0], start=ASIDE, first_frame=first_frame)
    after = corrected(imitator, part)
    step = first_step(after, ASIDE, place)
    assert {one.demonstration for one in step.followed} == {8}
    assert not step.is_novel
    assert missed(after, ASIDE) < 0.05 < before


@pytest.mark.parametrize("first_frame", [0, 20], ids=["whole", "from the middle"])
def test_from_where_it_began_it_does_as_before(imitator, first_frame):
    """Also where the goals of the correction are the nearest: it has not been shown the rest."""
    parts = [
        episode(20 + number, place, start=ASIDE, first_frame=first_frame)
        for number, place in enumerate(UNSEEN[:2])
    ]
    assert missed(corrected(imitator, *parts), REST) < 0.03


def test_a_correction_in_two_parts_is_one(imitator):
    """The first one ends midway, and not at the ball."""
    whole = episode(20, places(1, seed=3)[0], start=ASIDE, first_frame=20)
    place, parts = UNSEEN[0], (whole.part(0, 18), whole.part(19, FRAMES))
    ways = [path(corrected(imitator, *own), place, start=ASIDE) for own in ((whole,), parts)]
    assert np.linalg.norm(ways[0] - ways[1], axis=1).max() < 0.08  # .16 if each went to the ball


def test_corrections_of_another_task_are_not_followed(imitator):
    place = places(1, seed=3)[0]
    part = replace(episode(20, place, start=ASIDE, first_frame=20), task="push")
    other = corrected(imitator, part)
    other.reset("touch")
    assert other.step(ASIDE.astype(np.float32), {TOP: picture_of(place)}).is_novel
