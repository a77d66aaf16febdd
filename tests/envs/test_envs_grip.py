"""When a hand takes hold of a glass and when it lets go."""

import numpy as np
import pytest

from envs.grip import Grip
from envs.task import measure

NEAR = {"distance": 0.02, "slip": 0.0, "speed": 0.01, "height": 0.0}


def held_grip(height=0.0):
    grip = Grip()
    grip.update(**NEAR)
    assert grip.held
    grip.update(**{**NEAR, "height": height})
    return grip


@pytest.mark.parametrize(
    ("change", "held"),
    [({}, True), ({"distance": 0.035}, False), ({"speed": 0.2}, False)],
)
def test_a_hand_takes_hold_when_near_and_slow(change, held):
    grip = Grip()
    grip.update(**{**NEAR, **change})
    assert grip.held is held


def test_a_glass_not_yet_lifted_is_not_let_go():
    assert held_grip(height=0.01).held


def test_a_lifted_glass_is_let_go_on_the_table_when_slow():
    grip = held_grip(height=0.1)
    grip.update(**{**NEAR, "height": 0.005, "speed": 0.2})
    assert grip.held
    grip.update(**{**NEAR, "height": 0.005})
    assert not grip.held


def test_a_hand_that_let_go_must_leave_before_it_takes_hold_again():
    grip = held_grip()
    grip.release()
    grip.update(**NEAR)
    assert not grip.held
    grip.update(**{**NEAR, "distance": 0.1})
    assert not grip.held
    grip.update(**NEAR)
    assert grip.held


def test_the_grip_breaks_when_the_glass_is_pulled_away():
    grip = held_grip()
    grip.update(**{**NEAR, "slip": 0.02})
    assert grip.held
    grip.update(**{**NEAR, "slip": 0.04})
    assert not grip.held


def test_measures_of_a_standing_glass():
    """Mouth 3 cm above the rim's plane and 4 cm outside the rim: 5 cm."""
    glass, place = np.array([0.5, -0.07, 0.22]), np.array([0.5, -0.08])
    mouth = glass + np.array([0.036 + 0.04, 0.0, 0.07 + 0.03])
    measured = measure(mouth, glass, np.array([0.0, 0.0, 1.0]), place)
    assert measured.rim_to_mouth == pytest.approx(0.05)
    assert measured.glass_from_place == pytest.approx(0.01)
    assert measured.glass_tilt == 0
    assert measured.stands_at_place


@pytest.mark.parametrize(
    ("glass", "axis"),
    [
        ((0.5, -0.07, 0.3), (0.0, 0.0, 1.0)),  # in the air
        ((0.5, -0.07, 0.22), (0.0, 0.6, 0.8)),  # tilted
        ((0.55, -0.07, 0.22), (0.0, 0.0, 1.0)),  # elsewhere
        ((0.5, -0.07, 0.22), (0.0, 0.0, -1.0)),  # upside down
    ],
)
def test_a_glass_that_does_not_stand_at_its_place(glass, axis):
    measured = measure(np.zeros(3), np.array(glass), np.array(axis), np.array([0.5, -0.07]))
    assert not measured.stands_at_place
