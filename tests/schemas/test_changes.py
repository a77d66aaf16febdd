"""How a percept has changed lately: the ring of percepts that lie apart from one another."""

import numpy as np
import pytest

from pacnet.schemas.changes import HISTORY, RecentPercepts


def by_list(percepts: np.ndarray, least: float, frames: int) -> np.ndarray:
    """A second method: all percepts that lie apart, the oldest of the last few of them."""
    apart, changes = [], []
    for percept in percepts:
        if not apart or np.linalg.norm(percept - apart[-1]) >= least:
            apart.append(percept)
        changes.append(percept - apart[-1 - frames :][0])
    return np.array(changes)


@pytest.mark.parametrize("least", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("fps", [1, 10, 50])
def test_the_ring_is_what_a_list_gives(fps: int, least: float):
    rng = np.random.default_rng(fps)
    percepts = np.cumsum(rng.standard_normal((200, 3)), axis=0).astype(np.float32)
    recent = RecentPercepts(3, fps, least)
    expected = by_list(percepts, least, max(1, round(HISTORY * fps)))
    np.testing.assert_allclose(recent.changes(percepts), expected, atol=1e-5)


def test_changes_match_a_calculation_by_hand():
    recent = RecentPercepts(1, 10, least=0.9)  # 0.3 s are three frames
    percepts = np.float32([[0], [1], [2], [2.5], [4], [6], [6.5]])
    # 2.5 and 6.5 do not lie apart from the last one. The oldest of the last four is 0 up to 4,
    # then 1.
    expected = [0, 1, 2, 2.5, 4, 5, 5.5]
    assert recent.changes(percepts)[:, 0].tolist() == expected


def test_percept_by_percept_it_is_the_same_as_at_once():
    percepts = np.random.default_rng(0).standard_normal((60, 2)).astype(np.float32)
    at_once = RecentPercepts(2, 50, 0.5).changes(percepts)
    recent = RecentPercepts(2, 50, 0.5)
    one_by_one = [recent.changes(percept[None])[0] for percept in percepts]
    np.testing.assert_array_equal(one_by_one, at_once)


@pytest.mark.parametrize("pause", [1, 20, 500])
def test_a_pause_does_not_count(pause: int):
    path = np.cumsum(np.ones((100, 2), np.float32), axis=0)
    paused = np.concatenate([path[:50], np.repeat(path[49:50], pause, axis=0), path[50:]])
    changes = RecentPercepts(2, 50, 0.1).changes(paused)
    unpaused = RecentPercepts(2, 50, 0.1).changes(path)
    np.testing.assert_array_equal(np.delete(changes, range(50, 50 + pause), axis=0), unpaused)
    np.testing.assert_array_equal(changes[50 : 50 + pause], np.repeat(unpaused[49:50], pause, 0))


def test_after_a_reset_it_begins_anew_and_percepts_stay_as_they_are():
    percepts = np.random.default_rng(1).standard_normal((30, 2)).astype(np.float32)
    before, recent = percepts.copy(), RecentPercepts(2, 50, 0.1)
    first = recent.changes(percepts)
    recent.reset()
    np.testing.assert_array_equal(recent.changes(percepts), first)
    np.testing.assert_array_equal(percepts, before)


def test_the_change_is_over_the_same_time_at_any_frame_rate():
    for fps in (10, 50, 200):
        places = (np.arange(2 * fps) / fps).astype(np.float32)[:, None]  # 1 a second
        change = RecentPercepts(1, fps, 0.0).changes(places)[-1, 0]
        assert change == pytest.approx(HISTORY, rel=1e-3)
