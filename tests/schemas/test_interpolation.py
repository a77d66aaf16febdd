"""Between keyframes: a stretch takes as long as it was shown, a rest is shortened."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pacnet.schemas.demonstration_memory import DemonstrationMemory
from pacnet.schemas.interpolation import durations, interpolated

CORNERS = {0: (0.0, 0.0), 12: (6.0, 0.0), 30: (6.0, 9.0)}  # frame -> place, 0.5 a frame
FRAMES = 31


def polyline() -> np.ndarray:
    corners = np.array([*CORNERS.values()])
    return np.transpose(
        [np.interp(np.arange(FRAMES), [*CORNERS], corners[:, d]) for d in range(2)]
    ).astype(np.float32)


def memory_of(*demonstrations: np.ndarray) -> DemonstrationMemory:
    """Changes are ten times, targets minus the percepts."""
    memory = DemonstrationMemory(2, 2)
    for rows in demonstrations:
        memory.append(rows, 10 * rows, -rows, 0, correction=False)
    return memory


def lasting(places: list[float], frame: list[int]) -> list[int]:
    """Frames from each place, in one dimension, to the next."""
    rows = np.array(places, np.float32)[:, None]
    return durations(rows, np.array(frame), np.array([len(frame)])).tolist()


def test_what_is_whole_stays_the_same_object():
    shown = memory_of(polyline(), polyline()[:1]).shown()
    assert interpolated(shown) is shown


def test_the_corners_of_a_polyline_give_the_polyline():
    memory, first = memory_of(polyline(), polyline()[::-1].copy()), memory_of(polyline())
    kept = np.isin(np.arange(2 * FRAMES), [*CORNERS, *range(FRAMES, 2 * FRAMES)])
    memory.select(kept)
    whole = memory.whole()
    assert whole.first.tolist() == [0, FRAMES, 2 * FRAMES]
    assert whole.frames.tolist() == [FRAMES, FRAMES]
    for name in ("percepts", "changes", "targets", "time", "frame"):
        own, expected = getattr(whole, name)[:FRAMES], getattr(first.shown(), name)
        assert own.dtype == expected.dtype
        np.testing.assert_allclose(own, expected, atol=1e-5)
    np.testing.assert_array_equal(whole.percepts[FRAMES:], polyline()[::-1])
    assert memory.whole() is whole
    assert len(whole.low) == 2  # boxes around all frames


def test_a_rest_is_shortened_and_a_slow_movement_is_not_sped_up():
    # 5 in 50 frames is the usual speed, 0.1 a frame; 0.01 a frame is the least.
    assert lasting([0, 5, 5, 10], [0, 50, 3050, 3100]) == [50, 1, 50, 0]
    assert lasting([0, 5, 6, 11], [0, 50, 3050, 3100]) == [50, 100, 50, 0]
    assert lasting([0, 5, 10, 15], [0, 50, 300, 350]) == [50, 250, 50, 0]  # a fifth as fast
    assert lasting([0, 5, 10, 20], [0, 50, 100, 101]) == [50, 50, 1, 0]  # faster for a moment
    assert lasting([3, 3, 3], [0, 50, 3000]) == [1, 1, 0]  # nothing but rest


def test_a_pause_in_movements_there_and_back_that_are_equally_long():
    """Half of the way is passed at either speed: sums that differ in the last bit do not matter."""
    for way in np.random.default_rng(0).uniform(0.1, 9, 50):
        assert lasting([0, way, way, 0], [0, 10, 210, 310]) == [10, 1, 100, 0]


@pytest.mark.parametrize("seed", range(20))
def test_no_stretch_is_faster_than_shown_unless_it_is_slow(seed: int):
    rng = np.random.default_rng(seed)
    frame = rng.integers(1, 500, 30).cumsum()
    places = (10 ** rng.uniform(-3, 1, 30)).cumsum()
    shown, way = np.diff(frame), np.diff(places.astype(np.float32))
    lasts = np.array(lasting(places.tolist(), frame.tolist())[:-1])
    assert (lasts >= 1).all()
    assert (lasts <= shown).all()
    # By a second method: half of the way is passed at the usual speed or faster.
    speeds = np.sort(way / shown)
    usual = max(s for s in speeds if way[way / shown >= s].sum() >= way.sum() / 2 - 1e-9)
    shorter = lasts < shown
    assert shorter.any()
    assert (way[shorter] / shown[shorter] < 0.1 * usual).all()
    is_passed = lasts[shorter] > 1
    assert (way[shorter] / lasts[shorter] <= 0.1 * usual * (1 + 1e-5))[is_passed].all()


def test_frames_are_told_as_they_were_shown():
    rows = np.array([[0, 0], [5, 0], [5, 0], [10, 0]], np.float32)
    still = np.concatenate([np.linspace(rows[0], rows[1], 51), np.tile(rows[1:2], (2999, 1)),
                            np.linspace(rows[2], rows[3], 51)])  # fmt: skip
    memory = memory_of(still)
    memory.select(np.isin(np.arange(len(still)), [0, 50, 3050, 3100]))
    whole = memory.whole()
    assert whole.frames.tolist() == [102]
    assert whole.time.tolist() == [*range(102)]
    assert whole.frame.tolist() == [*range(51), *range(3050, 3101)]


def test_demonstrations_of_which_little_or_nothing_is_kept():
    memory = memory_of(polyline(), polyline(), polyline(), polyline())
    kept = np.zeros(4 * FRAMES, bool)
    kept[[5, 2 * FRAMES, 2 * FRAMES + 30, 3 * FRAMES + 7, 3 * FRAMES + 8]] = True
    memory.select(kept)
    whole = memory.whole()
    assert whole.frames.tolist() == [1, 0, FRAMES, 2]
    assert whole.first.tolist() == [0, 1, 1, FRAMES + 1, FRAMES + 3]
    assert whole.frame[[0, 1, -3, -2, -1]].tolist() == [5, 0, 30, 7, 8]
    np.testing.assert_array_equal(whole.percepts[0], polyline()[5])
    np.testing.assert_array_equal(whole.percepts[-2:], polyline()[7:9])
    for kind in (torch.float32, torch.float64, torch.bfloat16):  # states may be in any of them
        tensors = memory.state_dict()
        tensors["rows.percept"] = tensors["rows.percept"].to(kind)
        assert memory.frames_of(tensors).tolist() == [1, 0, FRAMES, 2]
