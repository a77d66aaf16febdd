"""How actions change beside what was shown: which are places, and the linear law of the others."""

import math

import numpy as np
import pytest
import torch

from pacnet.forward_models.correction import NO_PLACE, LinearCorrection, find_position_targets

FPS = 50


def path(frames: int = 200, seed: int = 0) -> torch.Tensor:
    """States `[T, 2]` that move to and fro, with different phases."""
    turn = torch.linspace(0, 4 * math.pi, frames) + seed
    return torch.stack([turn.sin(), turn.cos()], dim=1)


def ahead(state: torch.Tensor, frames: int) -> torch.Tensor:
    return torch.cat([state[frames:], state[-1:].expand(frames, -1)])


def test_places_are_found_by_name():
    states, names = [path(seed=0), path(seed=1)], ("shoulder", "elbow")
    actions = [state.flip(1) for state in states]
    found = find_position_targets(states, actions, names, ("elbow", "shoulder"), FPS)
    assert found == ((1, 0), 0)


def test_places_are_found_in_the_data_where_names_differ():
    states = [path()]
    actions = [torch.cat([state[:, 1:] + 0.1, state[:, :1]], dim=1) for state in states]
    found = find_position_targets(states, actions, ("a", "b"), ("motor 1", "motor 2"), FPS)
    assert found == ((1, 0), 0)


def test_what_has_the_name_of_a_state_is_a_place_of_no_other():
    state = path()
    action = state[:, 1:]  # it is b, but is called a
    assert find_position_targets([state], [action], ("a", "b"), ("a",), FPS) == ((NO_PLACE,), 0)
    assert find_position_targets([state], [action], ("a", "b"), ("c",), FPS) == ((1,), 0)


def test_speeds_and_displacements_are_no_places():
    turn = torch.linspace(0, 4 * math.pi, 200)
    state = torch.stack([turn.sin(), (1.7 * turn).sin()], dim=1)
    speed = FPS * (ahead(state, 1) - state)  # a quarter of a turn ahead, like neither of them
    both = torch.cat([speed, 0.01 * speed], dim=1)
    found = find_position_targets([state], [both], ("x", "y"), ("vx", "vy", "dx", "dy"), FPS)
    assert found == ((NO_PLACE,) * 4, 0)
    assert (
        find_position_targets([state], [speed], ("x", "y"), ("x", "y"), FPS)[0] == (NO_PLACE,) * 2
    )


@pytest.mark.parametrize("frames", [0, 1, 7, 25])
def test_places_lie_as_far_ahead_as_they_do(frames: int):
    states = [path(1000, seed) for seed in range(3)]
    actions = [ahead(state, frames) for state in states]
    _, lead = find_position_targets(states, actions, ("x", "y"), ("x", "y"), FPS)
    assert lead == frames


def test_a_place_beside_a_constant_action():
    state = path()
    action = torch.cat([ahead(state, 2)[:, :1], torch.ones(200, 1)], dim=1)
    found = find_position_targets([state], [action], ("x", "y"), ("x", "grip"), FPS)
    assert found == ((0, NO_PLACE), 2)


def test_without_a_state_there_is_no_place():
    nothing, action = torch.empty(30, 0), torch.rand(30, 2)
    assert find_position_targets([nothing], [action], (), ("u", "v"), FPS) == ((NO_PLACE,) * 2, 0)


@pytest.mark.parametrize("within", [False, True])
def test_the_gain_recovers_a_linear_law_from_noisy_pairs(within: bool):
    rng = np.random.default_rng(0)
    law = np.array([[1.0, -2.0], [0.5, 0.0], [0.0, 3.0]])
    correction = LinearCorrection(3, 2)
    for _ in range(5):
        percepts = rng.standard_normal((400, 3))
        actions = percepts @ law + 0.1 * rng.standard_normal((400, 2))
        correction.add(percepts.astype("f4"), actions.astype("f4"), within=within)
    # The products are 2000 times the identity; a ridge of 0.1 of that shrinks the law by 1.1.
    assert correction.gain() == pytest.approx(law / 1.1, abs=0.05)


def test_the_gain_is_that_of_ridge_regression():
    correction = LinearCorrection(2, 1)
    correction.add(np.float32([[1, 0], [0, 2]]), np.float32([[3], [2]]), within=False)
    # Products are diag(1, 4), a ridge of 0.1 · 5 / 2 = 0.25; responses are 3 and 4.
    assert correction.gain()[:, 0] == pytest.approx([3 / 1.25, 4 / 4.25])


def test_pairs_among_demonstrations_replace_those_within_one():
    correction, one = LinearCorrection(1, 1), np.ones((10, 1), np.float32)
    correction.add(one, 5 * one, within=True)
    assert correction.gain()[0, 0] == pytest.approx(5 / 1.1)
    correction.add(one, -2 * one, within=False)
    assert correction.gain()[0, 0] == pytest.approx(-2 / 1.1)


@pytest.mark.parametrize("pairs", [None, 0, 4])
def test_without_pairs_that_differ_nothing_is_corrected(pairs: int | None):
    correction = LinearCorrection(3, 2)
    if pairs is not None:
        correction.add(np.zeros((pairs, 3), "f4"), np.ones((pairs, 2), "f4"), within=False)
    assert correction.gain().tolist() == [[0.0, 0.0]] * 3


@pytest.mark.parametrize(
    ("name", "place", "value", "message"),
    [
        ("products", (0, 0, 0), -1.0, "products of differences"),
        ("products", (0, 0, 1), 50.0, "products of differences"),
        ("products", (1, 0, 0), math.nan, "finite sums"),
        ("responses", (0, 0, 0), math.inf, "finite sums"),
    ],
)
def test_sums_that_cannot_be_are_refused(name: str, place, value: float, message: str):
    correction = LinearCorrection(2, 1)
    correction.add(np.float32([[1, 0], [0, 2]]), np.float32([[3], [2]]), within=False)
    state, before = dict(correction.state_dict()), correction.gain()
    state[name] = state[name].clone()
    state[name][place] = value
    with pytest.raises(ValueError, match=message):
        correction.load_state_dict(state)
    assert np.array_equal(correction.gain(), before)
