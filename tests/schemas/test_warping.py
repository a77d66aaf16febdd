"""Demonstrations moved to other goals: what changes, how much of it when, and what stays."""

import numpy as np

from pacnet.schemas.demonstration_memory import DemonstrationMemory
from pacnet.schemas.warping import warped

FRAMES = 9
SHARES = (0.5, 1.0)


def shown():
    """One demonstration of two joints, a third number that is not the robot's, and two actions."""
    time = np.linspace(0, 1, FRAMES, dtype=np.float32)
    percepts = np.stack([time, 2 * time, np.full(FRAMES, 7, np.float32)], axis=1)
    targets = np.stack([10 * time, np.full(FRAMES, 3, np.float32)], axis=1)
    memory = DemonstrationMemory(3, 2)
    memory.append(percepts, np.zeros_like(percepts), targets, 0, False)
    return memory.whole()


def moved(apart, *, lead=0, follows=(0, -1)):
    return warped(
        shown(),
        [(0, FRAMES)],
        np.array([apart], float),
        SHARES,
        np.array([10.0, 5.0, 1.0]),
        np.array(follows),
        lead,
    )


def test_nothing_changes_without_a_change_of_goals():
    before, after = shown(), moved([[0, 0], [0, 0]])
    np.testing.assert_array_equal(after.percepts, before.percepts)
    np.testing.assert_array_equal(after.targets, before.targets)


def test_the_beginning_stays_and_each_goal_moves_by_all_of_its_change():
    before, after = shown(), moved([[0.2, 0], [0.6, -0.4]])
    change = after.percepts - before.percepts
    np.testing.assert_allclose(change[0], [0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(change[4], [0.2, 0, 0], atol=1e-6)  # half of the time is over
    np.testing.assert_allclose(change[8], [0.6, -0.4, 0], atol=1e-6)


def test_between_goals_the_change_is_between_theirs():
    before, after = shown(), moved([[0.2, 0], [0.6, 0]])
    change = (after.percepts - before.percepts)[:, 0]
    np.testing.assert_allclose(change[[2, 6]], [0.1, 0.4], atol=1e-6)


def test_targets_that_are_places_move_in_their_own_unit_and_ahead_of_time():
    before, after = shown(), moved([[0.2, 0], [0.6, 0]], lead=2)
    change = after.targets - before.targets
    # Ten units a scaled one; two frames ahead of the middle, .2 + .5 (.6 - .2) = .4.
    np.testing.assert_allclose(change[[0, 4, 8], 0], [1.0, 4.0, 6.0], atol=1e-5)
    np.testing.assert_array_equal(change[:, 1], 0)  # no place


def test_what_is_shown_is_left_as_it_is_and_can_be_searched():
    before = shown()
    copy = before.percepts.copy()
    after = moved([[5.0, 0], [5.0, 0]])
    np.testing.assert_array_equal(before.percepts, copy)
    assert after.high[:, 0].max() >= 5.9  # the boxes are around the new places
