"""Places are smoothed by as much as they are noisy, and not at all where they are not."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import CUP, HOME, carrying, noisy, path

from pacnet.schemas.smoothing import choose_smoothing, smooth

NOISE = 0.004  # [m]


def error(places: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Root mean square of each point's error over frames and dimensions, `[P]`."""
    return np.sqrt(np.square(places - truth).mean(axis=(0, 2)))


@pytest.mark.parametrize("fps", [20.0, 80.0, 200.0])
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_places_without_noise_are_left_alone(fps: float, unit: float):
    places = unit * carrying(fps)
    smoothed = smooth(places, choose_smoothing([places]))
    np.testing.assert_allclose(smoothed, places, rtol=1e-12)


@pytest.mark.parametrize("fps", [80.0, 200.0, 500.0])
def test_white_noise_becomes_less(fps: float):
    """At any rate: the slow change of speed between many frames is not taken for none."""
    truth = carrying(fps)
    places = [noisy(truth, NOISE, seed) for seed in range(3)]
    gains = choose_smoothing(places)
    for one in places:
        hand, cup, plate = error(smooth(one, gains), truth)
        assert max(hand, cup) < NOISE
        assert plate < 0.3 * NOISE


def test_a_static_point_is_averaged():
    truth = np.zeros((200, 1, 3))
    places = noisy(truth, NOISE, 0)
    gains = choose_smoothing([places])
    assert gains == ((pytest.approx(0.05), 0.0),)  # it may yet be moved
    forwards = places[:20].cumsum(axis=0) / np.arange(1, 21)[:, None, None]  # means up to a frame
    alone = smooth(places[:20], ((0.0, 0.0),))
    backwards = places[:20][::-1].cumsum(axis=0)[::-1] / np.arange(20, 0, -1)[:, None, None]
    np.testing.assert_allclose(alone, (forwards + backwards) / 2, atol=1e-12)
    assert smooth(places, gains).std() < 0.25 * NOISE


def test_a_place_and_its_speed_are_corrected_by_alpha_and_beta():
    places = np.zeros((5, 1, 3))
    places[:, 0, 0] = [0, 1, 2, 0, 0]
    forwards = [0.0]
    place, speed = 0.0, 0.0
    for frame, seen in enumerate([1, 2, 0, 0], start=2):
        apart = seen - (place + speed)
        place, speed = place + speed + max(0.4, 1 / frame) * apart, speed + 0.2 * apart
        forwards.append(place)
    # The first two by hand: 0 + 0.5 · 1 = 0.5 at a speed of 0.2; 0.7 + 0.4 · 1.3 = 1.22.
    assert forwards[:3] == pytest.approx([0, 0.5, 1.22])
    # Backwards: 0, 0, 0 + 0.4 · 2 = 0.8 at 0.4; 1.2 − 0.4 · 0.2 = 1.12 at 0.36; 1.48 − 0.4 · 1.48.
    backwards = [0.888, 1.12, 0.8, 0.0, 0.0]
    smoothed = smooth(places, ((0.4, 0.2),))
    assert smoothed[:, 0, 0] == pytest.approx((np.array(forwards) + backwards) / 2)
    np.testing.assert_allclose(smooth(places[::-1], ((0.4, 0.2),))[::-1], smoothed)


def test_the_gains_do_not_depend_on_unit_and_origin():
    places = noisy(carrying(80), NOISE, 1)
    gains = np.array(choose_smoothing([places]))
    for other in (1000 * places, np.add(places, (3.0, -1.0, 0.5))):
        np.testing.assert_allclose(choose_smoothing([other]), gains, rtol=1e-6)


def test_more_noise_is_smoothed_more():
    alphas = [
        choose_smoothing([noisy(carrying(80), noise, 0)])[0][0] for noise in (0, 1e-4, 1e-3, 1e-2)
    ]
    assert alphas == sorted(alphas, reverse=True)
    assert len(set(alphas)) == 4
    assert alphas[0] > 0.9


def test_each_point_has_gains_of_its_own():
    places = carrying(80)
    places[:, 2] = noisy(places[:, 2:], NOISE, 0)[:, 0]
    smoothed = smooth(places, choose_smoothing([places]))
    np.testing.assert_array_equal(smoothed[:, :2], places[:, :2])
    assert error(smoothed, carrying(80))[2] < 0.3 * NOISE


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_too_few_frames_to_tell_noise_are_left_alone(frames: int):
    places = noisy(np.zeros((frames, 2, 3)), 1.0, 0)
    gains = choose_smoothing([places])
    assert gains == ((1.0, 1.0), (1.0, 1.0))
    np.testing.assert_array_equal(smooth(places, gains), places)


def test_short_demonstrations_beside_long_ones_do_no_harm():
    long = noisy(path([HOME, CUP], [1.0], 80)[:, None], NOISE, 0)
    assert choose_smoothing([long, long[:2]]) == choose_smoothing([long])
