"""A demonstration is cut where the landmark changes that a hand is on its way to."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import CUP, GRASPED, HOME, PLATE, carrying, noisy, path, reaching

from pacnet.attention.cutting import carried, cut, measure, runs
from pacnet.schemas.smoothing import choose_smoothing, smooth

CUP_NUMBER, PLATE_NUMBER, NONE = 0, 1, -1
RATES = [20.0, 80.0, 200.0]  # [1/s]
TOLERANCE = 0.2  # [s] by which a cut may be off: a cup that is carried off begins slowly


def labels_of(places: np.ndarray, fps: float) -> np.ndarray:
    """The landmark of each frame, of a demonstration that is all that was shown."""
    return cut(places, measure([places[:, 0]], fps), fps)


def cuts_of(places: np.ndarray, fps: float) -> list[tuple[int, float]]:
    """The landmark of each segment, and when it begins [s]."""
    labels = labels_of(places, fps)
    return [(int(labels[first]), first / fps) for first, _ in runs(labels)]


def assert_carried(cuts: list[tuple[int, float]]) -> None:
    """The hand goes to the cup, and once this moves to the plate."""
    assert [landmark for landmark, _ in cuts] == [CUP_NUMBER, PLATE_NUMBER]
    assert cuts[1][1] == pytest.approx(GRASPED, abs=TOLERANCE)


def test_a_scene_is_measured_by_the_moved_point():
    slow = np.zeros((101, 3))
    slow[:, 0] = np.linspace(0, 3, 101)
    fast = 4 / 3 * slow[:, [1, 0, 2]]
    size = measure([slow, fast, fast], 100)
    assert size.extent == pytest.approx(4)  # the median of 3, 4 and 4
    assert size.speed == pytest.approx(np.sqrt((0.03**2 + 2 * 0.04**2) / 3))


@pytest.mark.parametrize("fps", RATES)
def test_a_hand_that_reaches_is_on_its_way_to_one_landmark(fps: float):
    assert cuts_of(reaching(fps), fps) == [(CUP_NUMBER, 0.0)]


@pytest.mark.parametrize("fps", RATES)
def test_what_is_fetched_is_a_landmark_until_it_is_carried(fps: float):
    places = carrying(fps)
    assert_carried(cuts_of(places, fps))
    moves = carried(places, measure([places[:, 0]], fps), fps)
    middle = round((GRASPED + 0.6) * fps)  # amidst the way to the plate
    assert moves[middle].tolist() == [True, False]
    assert not moves[: round((GRASPED - TOLERANCE) * fps)].any()


@pytest.mark.parametrize("fps", RATES)
def test_units_axes_and_origin_change_no_cut(fps: float):
    places = carrying(fps)
    sine, cosine = np.sin(np.pi / 6), np.cos(np.pi / 6)  # 30°
    turned = places @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    expected = labels_of(places, fps)
    for other in (1000 * places, turned, np.add(places, (5.0, -2.0, 1.0))):
        assert labels_of(other, fps).tolist() == expected.tolist()


def test_cuts_are_at_the_same_time_at_any_rate():
    times = [cuts_of(carrying(fps), fps)[1][1] for fps in RATES]
    assert np.ptp(times) <= 1 / min(RATES) + 1e-9


@pytest.mark.parametrize("fps", RATES)
@pytest.mark.parametrize("number", [CUP_NUMBER, PLATE_NUMBER])
@pytest.mark.parametrize("instead", [(0.0, 0.0, 0.0), HOME, (3.0, 3.0, 3.0)])
def test_a_landmark_reported_late_has_not_moved(number: int, instead: tuple, fps: float):
    places = carrying(fps)
    places[0, 1 + number] = instead
    moves = carried(places, measure([places[:, 0]], fps), fps)
    assert not moves[: round(fps)].any()
    assert_carried(cuts_of(places, fps))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("fps", [80.0, 200.0])
def test_noise_of_half_a_percent_makes_no_cut(fps: float, seed: int):
    clean = carrying(fps)
    places = noisy(clean, 0.005 * measure([clean[:, 0]], fps).extent, seed)
    smoothed = smooth(places, choose_smoothing([places]))
    assert_carried(cuts_of(smoothed, fps))


def test_the_landmark_attained_first_is_the_one_that_counts():
    """Past the cup to the plate, neither of which moves."""
    hand = path([HOME, CUP, PLATE], [1.0, 1.0], 80)
    places = np.stack([hand, np.broadcast_to(CUP, hand.shape), np.full_like(hand, PLATE)], axis=1)
    cuts = cuts_of(places, 80)
    assert [landmark for landmark, _ in cuts] == [CUP_NUMBER, PLATE_NUMBER]
    assert 1.0 < cuts[1][1] < 1.75  # it has left the cup


def test_the_numbers_of_landmarks_do_not_matter():
    places = carrying(80)
    swapped = labels_of(places[:, [0, 2, 1]], 80)
    assert swapped.tolist() == (1 - labels_of(places, 80)).tolist()


@pytest.mark.parametrize("end", [(-0.4, 0.0, 0.3), (0.0, -0.3, 0.5)])
def test_a_hand_that_approaches_nothing_moves_in_the_world(end: tuple[float, ...]):
    """Away from everything, or from side to side far from all."""
    hand = path([HOME, end, HOME], [1.0, 1.0], 80)
    places = np.stack([hand, np.full_like(hand, CUP), np.full_like(hand, PLATE)], axis=1)
    assert (labels_of(places[: len(hand) // 2], 80) == NONE).all()
    places[:, 1:] += (0.0, 0.0, 5.0)
    assert (labels_of(places, 80) == NONE).all()


def test_what_the_hand_begins_at_is_a_landmark():
    """A hand that goes away from a cup, of which alone it came close."""
    hand = path([tuple(np.add(CUP, 0.01)), HOME], [1.0], 80)
    places = np.stack([hand, np.full_like(hand, CUP), np.full_like(hand, (5.0, 5.0, 5.0))], axis=1)
    assert (labels_of(places, 80) == CUP_NUMBER).all()


def test_what_is_approached_half_the_way_is_a_landmark():
    """A hand that stops before the cup, as one that holds a tool does."""
    hand = path([HOME, (0.2, 0.05, 0.15)], [1.0], 80)
    places = np.stack([hand, np.full_like(hand, CUP), np.full_like(hand, (-0.2, 0.0, 0.4))], axis=1)
    assert (labels_of(places, 80) == CUP_NUMBER).all()


def test_what_the_hand_sets_in_motion_from_afar_is_a_landmark_before():
    """A rod that moves a cup: the hand comes no nearer to it than at first."""
    hand = path([HOME, HOME, (0.0, -0.3, 0.3)], [0.5, 1.0], 80)
    cup = np.array((0.1, 0.1, 0.25)) + hand - HOME
    places = np.stack([hand, cup], axis=1)
    labels = labels_of(places, 80)
    assert (labels[: round(0.4 * 80)] == CUP_NUMBER).all()
    assert labels[80] == NONE  # all landmarks move


def test_what_is_set_in_motion_from_afar_comes_before_what_is_reached_later():
    """A rod of 25 cm moves the cup; the hand is never near this, and then goes to the plate."""
    touches = (0.2, 0.0, 0.3)
    hand = path([HOME, touches, PLATE], [1.0, 1.0], 80)
    cup = np.array((0.0, -0.25, 0.0)) + np.where(np.arange(160)[:, None] < 80, touches, hand)
    places = np.stack([hand, cup, np.full_like(hand, PLATE)], axis=1)
    cuts = cuts_of(places, 80)
    assert [landmark for landmark, _ in cuts] == [CUP_NUMBER, PLATE_NUMBER]
    assert cuts[1][1] == pytest.approx(1.0, abs=TOLERANCE)


def test_without_landmarks_at_rest_there_is_none():
    hand = path([HOME, CUP], [1.0], 80)  # slow at either end
    carried = np.stack([hand, np.add(hand, (0.0, 0.0, 0.1))], axis=1)
    assert (labels_of(carried, 80)[20:-20] == NONE).all()


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_few_frames_are_one_segment(frames: int):
    places = carrying(80)
    labels = cut(places[:frames], measure([places[:, 0]], 80), 80)
    assert labels.shape == (frames,)
    assert len(runs(labels)) == 1


def test_runs_are_where_labels_are_equal():
    assert runs(np.array([3, 3, -1, 3])) == [(0, 2), (2, 3), (3, 4)]
    assert runs(np.array([7])) == [(0, 1)]
