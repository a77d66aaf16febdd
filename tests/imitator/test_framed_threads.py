"""One thread acts in frames of reference while another learns."""

from __future__ import annotations

import threading
import time

import numpy as np
from picking import World, demonstrate, scene, shown, somewhere, taught

from pacnet.imitator import Imitator

PLAIN = World()
LESSONS = 6


def first_action(imitator: Imitator) -> bytes:
    """What is done at the beginning of an episode, which is of one number of demonstrations."""
    imitator.reset()
    action = imitator.step(scene(PLAIN, (0.35, -0.1), (-0.1, 0.4)).percept).action
    assert action is not None
    return action.tobytes()


def test_it_acts_on_what_it_knew_before_a_demonstration_or_after_it():
    first, *later = [demonstrate(somewhere(PLAIN, seed), seed) for seed in range(LESSONS)]
    reference = taught(PLAIN, first)
    known = [first_action(reference)]
    for one in later:
        reference.learn(shown(PLAIN, one))
        known.append(first_action(reference))
    imitator = Imitator(reference.config)
    imitator.learn(shown(PLAIN, first))
    taken, errors = [first_action(imitator)], []

    def study() -> None:
        try:
            for one in later:
                imitator.learn(shown(PLAIN, one))
                enough, end = len(taken) + 3, time.monotonic() + 20
                while len(taken) < enough and time.monotonic() < end:
                    time.sleep(1e-4)
        except BaseException as error:  # for this thread to raise
            errors.append(error)

    thread = threading.Thread(target=study, daemon=True)
    thread.start()
    while thread.is_alive():
        taken.append(first_action(imitator))
    thread.join()
    taken.append(first_action(imitator))
    assert errors == []
    least = 0
    for answer in taken:
        assert answer in known[least:]
        least = known.index(answer, least)
    assert taken[-1] == known[-1]
    assert len(set(known)) > 2  # the demonstrations do make a difference
    assert len(taken) > 3 * len(later)
    for name, tensor in imitator.state_dict().items():
        np.testing.assert_array_equal(tensor, reference.state_dict()[name])
