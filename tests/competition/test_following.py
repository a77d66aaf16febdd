"""Following one demonstration: to its end, from beside it, held up, paused, pushed, half-way in."""

import math

import numpy as np
import pytest
from paths import FPS, bend, learned, line, run, shown, shown_by_speed

from pacnet.imitator import Imitator

BEND = bend()
HELD, MOST = range(40, 90), FPS // 2  # a second; the half of one in which the moment is looked for


@pytest.fixture(scope="module")
def bent() -> Imitator:
    return learned(shown(BEND))


def apart(places: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Distance of each place from the nearest one of a path."""
    return np.linalg.norm(places[:, None] - path, axis=2).min(axis=1)


def test_a_path_is_followed_to_its_end_from_its_own_start(bent: Imitator):
    done = run(bent, BEND[0], len(BEND))
    np.testing.assert_allclose(done.places[:-1], BEND, atol=1e-5)
    assert done.frames == [*range(len(BEND))]
    # It is done in the last tenth of a second, five frames.
    assert [step.is_done for step in done.steps].index(True) == len(BEND) - 1 - 5
    assert done.steps[-1].progress == 1


def test_a_robot_that_has_arrived_stays_there(bent: Imitator):
    done = run(bent, BEND[0], 5 * len(BEND))
    np.testing.assert_allclose(done.places[len(BEND) :], BEND[-1] + np.zeros((401, 2)), atol=1e-5)
    assert all(step.is_done for step in done.steps[len(BEND) :])


def test_an_offset_fades_along_the_way():
    path = line((0, 0), (2, 1))
    across = np.array([-1, 2]) / math.sqrt(5)
    done = run(learned(shown(path)), path[0] + 0.1 * across, len(path) + 5)
    offset = done.places @ across  # of the path it is 0
    # It is 0.1 at the beginning and 0 at the end of 99 steps, and fades evenly.
    assert offset[: len(path)] == pytest.approx(np.linspace(0.1, 0, len(path)), abs=0.01)
    assert done.places[-1] == pytest.approx(path[-1], abs=1e-4)


def test_where_the_robot_is_held_up_the_position_waits_and_then_goes_on(bent: Imitator):
    done = run(bent, BEND[0], 200, blocked=HELD)
    at = HELD[0]
    held = done.frames[at : HELD[-1] + 1]
    assert at - 2 <= min(held)
    assert max(held) <= at + MOST
    np.testing.assert_allclose(done.places[: at + 1], BEND[: at + 1], atol=1e-5)
    assert apart(done.places[HELD[-1] :], BEND).max() < 0.05
    assert done.places[-1] == pytest.approx(BEND[-1], abs=1e-3)
    # The second is lost, but for what the position ran ahead.
    arrived = [step.is_done for step in done.steps].index(True)
    assert len(BEND) + len(HELD) - MOST <= arrived <= len(BEND) + len(HELD)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("pause", [0.5, 1, 5])
def test_a_pause_that_was_shown_takes_as_long_as_shown(share: float, pause: float):
    at = round(share * len(BEND))
    still = np.repeat(BEND[at : at + 1], round(pause * FPS), axis=0)
    path = np.concatenate([BEND[:at], still, BEND[at:]])
    done = run(learned(shown(path)), path[0], 2 * len(path))
    arrived = [step.is_done for step in done.steps].index(True)
    assert arrived == pytest.approx(len(path) - 1, abs=0.1 * FPS)
    assert done.places[-1] == pytest.approx(path[-1], abs=1e-4)
    moved = np.linalg.norm(np.diff(done.places[: arrived + 1], axis=0), axis=1) > 1e-4
    assert np.sum(~moved) == pytest.approx(len(still), abs=0.1 * FPS)


@pytest.mark.parametrize("push", [(0.0, 0.3), (0.0, -0.3), (0.3, 0.0), (-0.3, 0.0)])
def test_after_a_push_it_is_led_back_at_once_and_does_not_begin_again(bent: Imitator, push):
    done = run(bent, BEND[0], 130, pushes={50: push})
    deviation = apart(done.places, BEND)
    assert deviation[50] > 0.08
    assert deviation[50 + round(0.3 * FPS) :].max() < 0.02
    assert min(done.frames[50:]) >= 48
    assert (np.diff(done.frames) >= 0).all()
    assert done.places[-1] == pytest.approx(BEND[-1], abs=1e-4)


@pytest.mark.parametrize("begin", [0.3, 0.5, 0.8])
def test_begun_in_its_middle_a_demonstration_is_gone_on_with(bent: Imitator, begin: float):
    at = round(begin * len(BEND))
    done = run(bent, BEND[at], len(BEND))
    # How it has moved is not known at first, so that a slower moment near by may fit better.
    assert done.frames[0] == pytest.approx(at, abs=0.4 * FPS)
    assert min(done.frames) == done.frames[0]
    arrived = [step.is_done for step in done.steps].index(True)
    assert arrived == pytest.approx(len(BEND) - 1 - at, abs=0.4 * FPS)
    assert done.places[-1] == pytest.approx(BEND[-1], abs=1e-4)


@pytest.mark.parametrize("by_speed", [False, True])
def test_a_path_that_crosses_itself_is_followed_through_the_crossing(by_speed: bool):
    turn = np.linspace(0, 2 * math.pi, 200)
    eight = np.stack([np.sin(turn), np.sin(2 * turn)], axis=1)  # by (0, 0) at 0, 100 and 199
    imitator = learned((shown_by_speed if by_speed else shown)(eight))
    done = run(imitator, eight[0], len(eight) - 1, by_speed=by_speed)
    np.testing.assert_allclose(done.places, eight, atol=1e-3)


def test_the_same_is_done_at_any_frame_rate():
    arrivals, half_way = [], []
    for fps in (10, 50, 200):
        path = bend(fps=fps)
        done = run(learned(shown(path, fps=fps)), (0.0, 0.2), round(2.5 * fps))
        arrivals.append([step.is_done for step in done.steps].index(True) / fps)
        half_way.append(done.places[fps])
        assert done.places[-1] == pytest.approx(path[-1], abs=1e-3)
    # Done is 0.1 s before the last frame, at 2 s − 1 / fps; the path comes nearest at 0.1 s.
    assert arrivals == pytest.approx([1.8 - 1 / fps for fps in (10, 50, 200)], abs=0.05)
    assert np.ptp(half_way, axis=0).max() < 0.1
