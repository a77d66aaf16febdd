"""One thread acts in frames of reference while another learns."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from picking import World, demonstrate, scene, shown, somewhere, taught

from pacnet.datasets.demonstrations import Demonstration
from pacnet.imitator import Imitator

PLAIN = World()
LESSONS = 6


def answer(imitator: Imitator) -> tuple[object, ...]:
    """What is done and told at the beginning of an episode, of one number of demonstrations."""
    imitator.reset()
    step = imitator.step(scene(PLAIN, (0.35, -0.1), (-0.1, 0.4)).percept)
    assert step.action is not None
    return step.action.tobytes(), step.followed, step.novelty, step.threshold


def study(
    imitator: Imitator,
    lessons: list[Demonstration],
    taken: list[tuple[object, ...]],
    errors: list[BaseException],
) -> None:
    """Learn one after the other, with three answers or more between two of them."""
    try:
        for one in lessons:
            imitator.learn(shown(PLAIN, one))
            enough, end = len(taken) + 3, time.monotonic() + 20
            while len(taken) < enough and time.monotonic() < end:
                time.sleep(1e-4)
    except BaseException as error:  # for the test's own thread to raise
        errors.append(error)


@pytest.mark.parametrize("budget", [None, 60])
def test_it_acts_on_what_it_knew_before_a_demonstration_or_after_it(budget: int | None):
    first, *later = [demonstrate(somewhere(PLAIN, seed), seed) for seed in range(LESSONS)]
    reference = Imitator(replace(taught(PLAIN, first).config, budget=budget))
    reference.learn(shown(PLAIN, first))
    known = [answer(reference)]
    for one in later:
        reference.learn(shown(PLAIN, one))
        known.append(answer(reference))
    imitator = Imitator(reference.config)
    imitator.learn(shown(PLAIN, first))
    taken, errors = [answer(imitator)], []
    thread = threading.Thread(target=study, args=(imitator, later, taken, errors), daemon=True)
    thread.start()
    while thread.is_alive():
        taken.append(answer(imitator))
    assert errors == []
    taken.append(answer(imitator))
    least = 0
    for one in taken:
        assert one in known[least:]
        least = known.index(one, least)
    assert taken[-1] == known[-1]
    assert len(set(known)) > 2  # demonstrations do make a difference
    assert len(taken) > 3 * len(later)
    for name, tensor in imitator.state_dict().items():
        np.testing.assert_array_equal(tensor, reference.state_dict()[name])
