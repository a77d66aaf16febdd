"""The law of a point that moves alike in all directions: found from little, taken if it fits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacnet.forward_models.affine_alike import fit_alike
from pacnet.forward_models.affine_fit import Law, fit_law
from pacnet.forward_models.affine_rows import rows_of

GAIN, LAG = 0.02, 0.6  # change per frame for an action of 1, and what of it goes on
NO_TURN = np.eye(3)
TURNS = {
    "quarter": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "mirrored": np.diag([1.0, -1, 1]),
    "other": Rotation.from_rotvec([0.7, -1.1, 1.9]).as_matrix(),
}


def actions(frames: int, seed: int, width: int = 3) -> np.ndarray:
    """Actions `[T, U]` within ±1 that change smoothly."""
    rng = np.random.default_rng(seed)
    pace, begin = rng.uniform(1, 5, (2, width))
    return np.sin(pace * np.linspace(0, 2 * np.pi, frames)[:, None] + 6 * begin)


def moved(sent: np.ndarray, law: np.ndarray, lag: float = LAG) -> np.ndarray:
    """Places `[T, S]` that `law @ action` moves from each frame to the next, and that go on."""
    places, speed = [np.zeros(len(law))], np.zeros(len(law))
    for action in sent[:-1]:
        speed = lag * speed + law @ action
        places.append(places[-1] + speed)
    return np.stack(places)


def in_contact(places: np.ndarray, first: int, end: int) -> np.ndarray:
    """The same, but for frames in which something holds the point where it is."""
    steps = np.diff(places, axis=0, prepend=places[:1])
    steps[first:end] = 0
    return steps.cumsum(axis=0)


def law_of(places: np.ndarray, sent: np.ndarray, lead: int = 1) -> Law:
    return fit_law([places], [sent], (-1,) * sent.shape[1], lead)


def moments(places: np.ndarray, sent: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What `fit_alike` takes, of one frame ahead."""
    steps = np.diff(places, axis=0)
    return sent[1:-1], steps[:-1], steps[1:]


@pytest.mark.parametrize("turn", [NO_TURN, *TURNS.values()], ids=["straight", *TURNS])
@pytest.mark.parametrize("lag", [0.0, LAG, 0.9])
def test_gain_lag_and_axes_are_recovered(turn: np.ndarray, lag: float):
    sent = actions(80, 0)
    found = fit_alike(*moments(moved(sent, GAIN * turn, lag), sent))
    np.testing.assert_allclose(found[:3].T, GAIN * turn, atol=1e-6)
    np.testing.assert_allclose(found[3:], lag * np.eye(3), atol=1e-4)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_unit_does_not_matter(unit: float):
    sent, truth = actions(80, 1), moved(actions(80, 1), GAIN * NO_TURN)
    noisy = truth + 1e-4 * np.random.default_rng(0).standard_normal(truth.shape)
    found, expected = (fit_alike(*moments(factor * noisy, sent)) for factor in (unit, 1.0))
    np.testing.assert_allclose(found[:3], unit * expected[:3], rtol=1e-6)
    np.testing.assert_allclose(found[3:], expected[3:], rtol=1e-6)


def test_nothing_that_moves_has_no_gain():
    assert not fit_alike(actions(30, 0), np.zeros((30, 3)), np.zeros((30, 3))).any()


@pytest.mark.parametrize("seed", range(3))
def test_frames_in_contact_hardly_count(seed: int):
    """A tenth of the time something is in the way; five frames ahead."""
    sent = actions(120, seed)
    places = in_contact(moved(sent, GAIN * NO_TURN, lag=0.0), 70, 82)
    rows = rows_of([places], [sent], (-1,) * 3, 5)
    gain = fit_alike(rows.inputs[:, :3], rows.inputs[:, 3:], rows.changes)[:3].T
    np.testing.assert_allclose(gain, 5 * GAIN * NO_TURN, atol=0.05 * 5 * GAIN)
    plain = np.linalg.lstsq(rows.inputs, rows.changes, rcond=None)[0]
    assert np.abs(plain[:3].T - 5 * GAIN * NO_TURN).max() > 0.1 * 5 * GAIN  # is fooled


def test_noise_turns_no_axes():
    """Axes are turned where that is clearly better, not by what noise looks like."""
    sent = 0.1 * actions(40, 3)
    noise = GAIN * np.random.default_rng(0).standard_normal((40, 3)) / 10
    found = fit_alike(*moments(moved(sent, GAIN * NO_TURN) + noise, sent))
    np.testing.assert_array_equal(found[:3], found[0, 0] * NO_TURN)


@pytest.mark.parametrize("size", [2, 3])
def test_a_hand_that_moves_alike_has_the_simple_law(size: int):
    """From one short demonstration with noise, with a gripper that moves nothing."""
    sent = actions(60, 4, size)
    places = moved(sent, GAIN * np.eye(size))
    places += 0.02 * GAIN * np.random.default_rng(0).standard_normal(places.shape)
    grip = (np.arange(60) > 30)[:, None] * 2.0 - 1
    law = law_of(places, np.concatenate([sent, grip], axis=1))
    assert law.moves.tolist() == [True] * size + [False]
    np.testing.assert_array_equal(law.gain, law.gain[0, 0] * np.eye(size, size + 1))
    np.testing.assert_array_equal(law.lag, law.lag[0, 0] * np.eye(size))
    assert law.gain[0, 0] == pytest.approx(GAIN, rel=0.1)
    assert law.lag[0, 0] == pytest.approx(LAG, abs=0.1)
    assert law.drift.tolist() == [0] * size
    assert law.explained.min() > 0.95


def test_the_simple_law_leads_as_far_as_was_asked():
    """Over five frames an action moves five times as far."""
    sent = actions(100, 5)
    law = law_of(moved(sent, GAIN * NO_TURN, lag=0.0), sent, lead=5)
    np.testing.assert_allclose(law.gain, 5 * GAIN * NO_TURN, atol=0.05 * GAIN)


def test_contact_does_not_lower_the_gain_of_a_hand():
    sent = actions(120, 2)
    law = law_of(in_contact(moved(sent, GAIN * NO_TURN, lag=0.0), 70, 82), sent, lead=5)
    np.testing.assert_allclose(law.gain, 5 * GAIN * NO_TURN, atol=0.1 * 5 * GAIN)


@pytest.mark.parametrize("gains", [(1.0, 1.0, 0.3), (1.0, 0.3, 3.0)])
def test_axes_that_clearly_differ_keep_gains_of_their_own(gains: tuple[float, ...]):
    sent = actions(150, 6)
    places = moved(sent, GAIN * np.diag(gains), lag=0.0)
    places += 0.02 * GAIN * np.random.default_rng(0).standard_normal(places.shape)
    law = law_of(places, sent)
    own, shared = np.diag(law.gain) / GAIN, law.gain.diagonal().mean() / GAIN
    assert np.abs(own - gains).max() < 0.5 * np.abs(shared - np.array(gains)).max()
    assert law.explained.min() > 0.9


def test_a_drift_that_is_clear_stays():
    """A hand that sinks whatever is commanded."""
    sent = actions(150, 7)
    sinking = np.arange(150)[:, None] * np.array([0.0, 0.0, -GAIN])
    law = law_of(moved(sent, GAIN * NO_TURN, lag=0.0) + sinking, sent)
    assert law.drift[2] + law.lag[2, 2] * -GAIN == pytest.approx(-GAIN, rel=0.1)


def test_one_action_of_a_point_in_space_has_no_simple_law():
    """Nor have places that are commanded: both are left to the law that has more coefficients."""
    sent = actions(100, 8, 1)
    law = law_of(moved(sent, GAIN * np.array([[1.0], [2], [0]]), lag=0.0), sent)
    np.testing.assert_allclose(law.gain.ravel(), [GAIN, 2 * GAIN, 0], atol=0.05 * GAIN)
    goals = actions(100, 9)
    places = [np.zeros(3)]
    for goal in goals[:-1]:
        places.append(places[-1] + np.array([0.1, 0.2, 0.3]) * (goal - places[-1]))
    law = fit_law([np.stack(places)], [goals], (0, 1, 2), 1)
    np.testing.assert_allclose(law.gain, np.diag([0.1, 0.2, 0.3]), atol=0.02)
