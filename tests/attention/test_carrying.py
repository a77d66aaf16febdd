"""What is carried, from when to when, and where it is put back; a withdrawal has no landmark."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import CUP, HELD, HOME, noisy, path, reaching

from pacnet.attention.cutting import Size, carried, cut, measure, runs, was_put_back
from pacnet.schemas.smoothing import choose_smoothing, smooth

GRIP = tuple(np.subtract(CUP, HELD))
NEAR = tuple(np.add(GRIP, 0.01))
MOUTH, BESIDE = (0.0, 0.1, 0.6), (0.1, 0.5, 0.2)
FAR = (3.0, 3.0, 3.0)  # a landmark that is never approached
NONE = -1


def scene(
    stops: list[tuple[float, ...]], seconds: list[float], held: list[tuple[int, int]], fps: float
) -> np.ndarray:
    """A hand, a cup, and a landmark far away; the cup goes along from one stop to another."""
    hand = path(stops, seconds, fps)
    at = np.cumsum([0, *(round(time * fps) for time in seconds)])
    cup = np.tile(np.array(CUP, float), (len(hand), 1))
    for first, last in held:
        cup[at[first] : at[last]] = hand[at[first] : at[last]] + HELD
        cup[at[last] :] = np.add(stops[last], HELD)
    return np.stack([hand, cup, np.full_like(hand, FAR)], axis=1)


def drinking(fps: float) -> np.ndarray:
    """The cup is fetched at 1.25 s, at the mouth from 2.25 s to 2.75 s, back at 3.75 s."""
    stops = [HOME, GRIP, GRIP, MOUTH, MOUTH, GRIP, GRIP, HOME]
    return scene(stops, [1, 0.25, 1, 0.5, 1, 0.25, 1], [(2, 5)], fps)


def moving(places: np.ndarray, fps: float, landmark: int = 0) -> list[tuple[float, float]]:
    """From when to when a landmark is carried [s]."""
    moves = carried(places, measure([places[:, 0]], fps), fps)[:, landmark]
    return [(a / fps, b / fps) for a, b in runs(moves.astype(np.int64)) if moves[a]]


def legs(places: np.ndarray, fps: float) -> list[tuple[int, float]]:
    """The landmark of each segment, and when it begins [s]; the cup's former place is the last."""
    stood = np.broadcast_to(places[:1, 1], places[:, 1].shape)
    labels = cut(
        np.concatenate([places, stood[:, None]], axis=1), measure([places[:, 0]], fps), fps, (0,)
    )
    return [(int(labels[first]), first / fps) for first, _ in runs(labels)]


@pytest.mark.parametrize("fps", [20.0, 80.0, 200.0])
def test_what_is_put_back_is_taken_to_where_it_stood(fps: float):
    """To the cup, away, back once it was farthest, and away from it again."""
    found = legs(drinking(fps), fps)
    assert [landmark for landmark, _ in found][:3] == [0, NONE, 2]
    assert found[-1][0] == NONE  # the hand withdraws
    assert found[1][1] == pytest.approx(1.25, abs=0.2)
    assert 2.75 < found[2][1] < 3.0  # when it is 5 % of the scene's size nearer
    assert 3.75 < found[-1][1] < 4.6


def test_units_and_rates_change_no_place_where_it_is_put_back():
    assert legs(1000 * drinking(80), 80) == legs(drinking(80), 80)


def test_a_former_place_is_no_landmark_on_any_other_way():
    """Though the hand goes there before, and the cup is elsewhere in the end."""
    stops = [HOME, GRIP, GRIP, BESIDE, GRIP]
    places = scene(stops, [1, 0.25, 1, 1], [(2, 3)], 80)
    assert 2 not in [landmark for landmark, _ in legs(places, 80)]


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        ([0, 0.2, 0.4, 0.2, 0.0], True),
        ([0, 0.2, 0.4, 0.2, 0.04], True),  # 4 % of the scene's size off
        ([0, 0.2, 0.4, 0.2, 0.06], False),
        ([0, 0.1, 0.29, 0.1, 0.0], False),  # it was hardly moved: less than 30 %
        ([0, 0.2, 0.4, 0.4, 0.4], False),
    ],
)
def test_put_back_is_what_was_far_away_and_is_near_in_the_end(way: list[float], expected: bool):
    apart, size = np.array([0.0, *way, way[-1]]), Size(1.0, 0.1)
    moves = np.array([False, *[True] * len(way), False])
    assert was_put_back(apart, moves, size) == expected
    assert was_put_back(1000 * apart, moves, Size(1000.0, 100.0)) == expected
    assert not was_put_back(apart, np.zeros(len(apart), bool), size)


def test_it_is_on_the_way_back_from_the_last_frame_in_which_it_was_farthest():
    """It stays at the mouth for half a second, which is not the way back."""
    apart = np.array([0, 0, 0.5, 0.99, 1.0, 0.97, 0.9, 0.5, 0.03, 0.03])
    places = np.zeros((len(apart), 4, 3))
    places[:, :2, 0] = apart[:, None]  # hand and cup; the cup's place is at the origin
    places[:, 2] = FAR
    labels = cut(places, Size(1.0, 0.2), 10.0, (0,))
    assert labels.tolist()[2:] == [NONE] * 4 + [2] * 4


def test_what_the_hand_came_to_and_left_is_no_landmark_any_more():
    """But what it began at is, until it goes elsewhere."""
    hand = path([HOME, GRIP, HOME], [1.0, 1.0], 80)
    places = np.stack([hand, np.full_like(hand, NEAR), np.full_like(hand, FAR)], axis=1)
    labels = cut(places, measure([hand], 80), 80)
    assert (labels[:80] == 0).all()
    assert (labels[120:] == NONE).all()
    begins = places[80:]  # at the cup
    assert (cut(begins, measure([begins[:, 0]], 80), 80) == 0).all()


def test_one_that_is_come_to_again_is_a_landmark_meanwhile():
    hand = path([HOME, GRIP, HOME, GRIP], [1.0, 1.0, 1.0], 80)
    places = np.stack([hand, np.full_like(hand, CUP), np.full_like(hand, FAR)], axis=1)
    assert (cut(places, measure([hand], 80), 80) == 0).all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("fps", [20.0, 80.0])
def test_noise_alone_carries_nothing(fps: float, seed: int):
    """Of a cup that stands while the hand comes and goes; in shares of the scene's size."""
    once = reaching(fps)
    clean = np.concatenate([once, once[::-1]] * 2)
    extent = measure([clean[:, 0]], fps).extent
    assert moving(noisy(clean, 0.005 * extent, seed), fps) == []
    places = noisy(clean, 0.01 * extent, seed)
    assert moving(smooth(places, choose_smoothing([places])), fps) == []


def test_what_is_held_at_rest_for_long_is_carried_all_the_same():
    """Moved within a second, and then held for 20."""
    places = scene([HOME, GRIP, GRIP, MOUTH, MOUTH], [1, 0.25, 1, 20], [(2, 4)], 20)
    ((first, end),) = moving(places, 20)
    assert first == pytest.approx(1.25, abs=0.25)
    assert end == pytest.approx(22.25)


def test_between_two_carries_it_stands():
    """At home for five seconds first; the cup stands elsewhere for more than two, then is back."""
    stops = [HOME, HOME, GRIP, GRIP, BESIDE, BESIDE, HOME, BESIDE, BESIDE, GRIP, HOME]
    seconds = [5, 1, 0.25, 1, 0.25, 1, 1, 0.25, 1, 1]
    found = moving(scene(stops, seconds, [(3, 4), (8, 9)], 80), 80)
    assert [round(begin) for begin, _ in found] == [6, 10]
    assert found[0][1] < 8  # left soon after 7.5 s
    assert found[1][0] > 9.75


def test_what_falls_into_place_is_not_carried():
    """The cup moves on its own while the hand goes elsewhere."""
    hand = path([HOME, GRIP, HOME], [1.0, 1.0], 80)
    cup = np.full_like(hand, CUP)
    cup[80:] += path([(0.0,) * 3, (0.3, 0.0, -0.1)], [1.0], 80)
    places = np.stack([hand, cup, np.full_like(hand, FAR)], axis=1)
    assert moving(places, 80) == []
