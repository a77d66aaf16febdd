"""What is perceived of Metaworld's observations: landmarks, relative places, views."""

import numpy as np
import pytest
from metaworld_toys import demonstrations, observation

from benchmarks.metaworld import tasks
from benchmarks.metaworld.features import (
    GRIPPER,
    View,
    environment_names,
    landmarks_of,
    percept_of,
    places_of,
    relative,
)

HAND, THING, SECOND, GOAL = np.array(
    [[0.1, 0.2, 0.3], [0.5, 0.0, 0.1], [0.0, 0.4, 0.2], [1.0, 2.0, 3.0]]
)
MOVE = np.array([0.3, -0.1, 0.2])
ONE = observation(HAND, THING, GOAL)
TWO = observation(HAND, THING, GOAL, SECOND)


def test_a_percept_is_hand_gripper_and_landmarks():
    assert landmarks_of(ONE) == ("object", "goal")
    assert landmarks_of(TWO) == ("object", "object2", "goal")
    assert percept_of(ONE, landmarks_of(ONE)) == pytest.approx([*HAND, 1.0, *THING, *GOAL])
    both = percept_of(np.stack([TWO, TWO]), landmarks_of(TWO))
    assert both.shape == (2, 13)
    assert both[1] == pytest.approx([*HAND, 1.0, *THING, *SECOND, *GOAL])
    assert environment_names(("object", "goal"))[2:4] == ("object.z", "goal.x")


def test_relative_places_are_differences():
    two = relative(percept_of(TWO, landmarks_of(TWO)))
    expected = [1.0, *(THING - HAND), *(GOAL - HAND), *(GOAL - THING), *(SECOND - HAND)]
    assert two == pytest.approx(expected, abs=1e-6)
    assert relative(percept_of(ONE, landmarks_of(ONE))) == pytest.approx(expected[:10], abs=1e-6)


def test_relative_places_stay_the_same_when_everything_is_moved():
    moved = observation(*(place + MOVE for place in (HAND, THING, GOAL, SECOND)))
    before, after = (relative(percept_of(o, landmarks_of(TWO))) for o in (TWO, moved))
    assert after == pytest.approx(before, abs=1e-6)


def test_a_view_changes_units_and_axes_of_places_and_leaves_the_gripper():
    percept = percept_of(observation(np.array([1.0, 0.0, 0.5]), THING, GOAL), ("object", "goal"))
    turned = View(units=1000, turn=90).see(percept)
    assert turned[:4] == pytest.approx([0, -1000, 500, 1.0], abs=1e-3)  # +x lies on the new −y
    assert turned[4:7] == pytest.approx([0, -500, 100], abs=1e-3)
    assert np.array_equal(View().see(percept), percept)


def test_turned_axes_keep_distances():
    percept = percept_of(TWO, landmarks_of(TWO))
    for places, turned in zip(
        places_of(percept), places_of(View(turn=30).see(percept)), strict=True
    ):
        assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(places), rel=1e-5)
    back = View(turn=-30).see(View(turn=30).see(percept))
    assert back == pytest.approx(percept, abs=1e-6)


def test_noise_is_of_all_places_in_metres_and_repeats_with_its_seed():
    percepts = np.tile(percept_of(ONE, ("object", "goal")), (4_000, 1))
    view = View(noise=0.01, units=1000)
    seen = view.see(percepts, np.random.default_rng(0))
    error = places_of(seen - View(units=1000).see(percepts))
    assert error.std(axis=0) == pytest.approx(np.full((3, 3), 10.0), rel=0.05)  # [mm]
    assert (seen[:, 3] == 1.0).all()
    assert np.array_equal(seen, view.see(percepts, np.random.default_rng(0)))


def test_what_is_learned_from_is_seen_in_the_same_units_axes_and_noise():
    shown = demonstrations(2)
    before = shown.episodes[1].percepts.clone()
    seen = View(units=10, turn=30).seen(shown)
    expected = View(units=10, turn=30).see(before.numpy())
    assert np.array_equal(seen.episodes[1].percepts.numpy(), expected)
    noisy = View(noise=0.1, units=10, turn=30).seen(shown).episodes[1].percepts.numpy()
    apart = np.delete(noisy - expected, GRIPPER, axis=1)
    assert apart.std() == pytest.approx(10 * 0.1, rel=0.2)
    assert seen.episodes[1].state.shape == (40, 4)
    assert np.array_equal(seen.episodes[1].action, shown.episodes[1].action)
    assert np.array_equal(shown.episodes[1].percepts, before)


def test_a_view_is_named_by_what_is_unusual():
    assert str(View()) == ""
    assert str(View(noise=0.002, turn=30)) == "noise 0.002, turn 30"


def test_tasks_are_chosen_by_set_and_by_name_once():
    assert len(tasks.DEVELOPMENT) == 15
    assert len(tasks.HELD_OUT) == 9
    assert not set(tasks.DEVELOPMENT) & set(tasks.HELD_OUT)
    assert tasks.choose(["soccer", "held-out", "reach-v3"])[0] == "soccer"
    assert len(tasks.choose(["soccer", "held-out", "reach-v3"])) == 10
    assert [tasks.set_of(t) for t in ("reach", "push", "sweep")] == [
        "development", "held-out", "other"
    ]  # fmt: skip
